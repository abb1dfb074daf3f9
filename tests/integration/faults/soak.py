"""Random faults, one after the other, against living nodes; after each, what must hold is checked.

``./run soak --minutes 20`` finds nothing. What it finds, the seed that it prints finds again, as
far as that depends on the order of the faults.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import support  # noqa: F401 - sets up the environment that rclpy reads when it is imported
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from invariants import (
    GOOD,
    UNREACHABLE,
    assert_all_numbers_finite,
    assert_every_command_belongs_to_a_target,
    counts_in,
    good_target,
    listen_to_all_commands,
    path_message,
    wait_for_pairs,
)
from mutations import message_of, mutated
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from support.client import Client
from support.nodes import NodeProcess

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, checked_pose
from annik_core.target_paths import diagonal_path
from examples.demonstration import reserved_domain
from msg_tools.bags.reader import read_bag
from msg_tools.conversions.pose import pose_from_array, pose_to_array

#: A node that has grown by more than this keeps what it should drop [bytes].
LARGEST_GROWTH = 60e6
#: Both are sent at once, and none may be lost on the way: less than every queue holds.
BURST = 400
ERROR = "tracking_error/orientation"
TOPICS = {Pose: "target_pose", PoseStamped: "target_pose_stamped", PoseArray: "target_poses"}


def resident_memory(process: int) -> int:
    """Memory of a process [bytes]."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return os.sysconf("SC_PAGE_SIZE") * pages


class Soak:
    """Two nodes, a client, and what is known of them.

    Attributes:
        faults: what can be done to them, by name.
        sent: how many targets were sent in all.
    """

    def __init__(self, seed: int, folder: Path, domain: int) -> None:
        """Start the nodes; their logs and the model that they serve go to ``folder``."""
        self.sent = 0
        self._random = random.Random(seed)
        self._folder = folder
        self._domain = domain
        self._model = folder / "model.onnx"
        self._processes: dict[str, NodeProcess] = {}
        self._memory: dict[int, int] = {}
        self._started = 0
        self._received = 0
        self._good: dict[float, FloatArray] = {}
        self._fuzzed: list[bytes] = []
        self._restore_model()
        self._client = Client(domain)
        listen_to_all_commands(self._client)
        deep = QoSProfile(depth=10_000)
        self._publishers = {
            kind: self._client.node.create_publisher(kind, topic, deep)
            for kind, topic in TOPICS.items()
        }
        self._clock = self._client.node.create_publisher(Clock, "/clock", QoSProfile(depth=1))
        self._states = self._client.node.create_publisher(
            JointState, "joint_states", qos_profile_sensor_data
        )
        self.faults: dict[str, Callable[[], None]] = {
            "follow a path": self._follow_a_path,
            "fuzzed targets": self._send_fuzzed_targets,
            "a flood": self._flood,
            "paths, good and bad": self._send_paths,
            "silence and a burst": self._be_silent,
            "two publishers at once": self._publish_from_two_sides,
            "best effort": self._publish_with_best_effort,
            "broken joint states": self._publish_broken_joint_states,
            "model file spoilt": self._spoil_the_model,
            "bad parameters": self._set_bad_parameters,
            "limits changed": self._change_limits,
            "impossible transitions": self._ask_for_the_impossible,
            "inactive for a while": self._deactivate,
            "configured anew": self._configure_anew,
            "simulated time": self._simulate_time,
            "ik_node stopped": lambda: self._stop("ik_node"),
            "fake_robot stopped": lambda: self._stop("fake_robot"),
            "ik_node killed": self._kill_the_ik_node,
            "fake_robot killed": self._kill_the_robot,
            "a recording": self._record,
        }
        for name in ("ik_node", "fake_robot"):
            self._start(name)
        self._find_each_other()

    def close(self) -> None:
        """End everything."""
        self._client.close()
        for process in self._processes.values():
            process.kill()

    def order(self) -> list[str]:
        """Every fault once, in an order that is another each time."""
        names = list(self.faults)
        self._random.shuffle(names)
        return names

    def check(self) -> None:
        """Fail unless everything holds that must."""
        self._send_good()
        last = self._newest()
        self._client.wait_for_results(last, ["joint_command", ERROR])
        for name, process in self._processes.items():
            assert process.is_running, f"{name} has ended"
            assert "Traceback" not in process.log, f"{name} had an exception"
            now = resident_memory(process.pid)
            before = self._memory.setdefault(process.pid, now)
            assert now - before < LARGEST_GROWTH, f"{name} has grown by {now - before} bytes"
        self._check_counts()
        self._check_commands()

    def _check_counts(self) -> None:
        _, values = self._client.wait_for_status(
            "ik_node",
            lambda values: int(values.get("targets received", -1)) >= self._received,
            f"{self._received} targets received",
        )
        received = counts_in(values).received
        assert received == self._received, f"{received} targets received of {self._received}"
        robot = self._client.status("fake_robot")
        assert robot is None or counts_in(robot[1], "commands").refused == 0

    def _check_commands(self) -> None:
        # Before they are looked at: while it waits, more may arrive.
        wait_for_pairs(self._client)
        accepted = [
            checked_pose(pose_to_array(message.pose))
            for message in self._client.received["accepted_target"]
        ]
        fuzzed = b"".join(self._fuzzed)
        for pose in accepted:
            sent = self._good.get(float(pose[0]))
            if sent is None:
                x, y, z = pose[:3].tolist()
                assert struct.pack("<3d", x, y, z) in fuzzed or (
                    struct.pack(">3d", x, y, z) in fuzzed
                ), f"{pose} was never sent"
        assert_every_command_belongs_to_a_target(self._client, accepted)
        self._forget()

    def _forget(self) -> None:
        for topic, messages in self._client.received.items():
            if topic != "/diagnostics":
                messages.clear()
        self._good.clear()
        self._fuzzed.clear()

    def _start(self, name: str) -> None:
        self._started += 1
        arguments = {
            "ik_node": (
                *("-p", f"model:={self._model}", "-p", "queue_depth:=10000"),
                *("-p", "publish_joint_trajectory:=true", "-p", "publish_position_commands:=true"),
                "-p",
                f"executor:={self._random.choice(['events', 'single_threaded'])}",
            ),
            "fake_robot": (),
        }[name]
        log = self._folder / f"{self._started:04}_{name}.log"
        self._processes[name] = NodeProcess(name, arguments, self._domain, log)
        self._processes[name].wait_until_ready()

    def _find_each_other(self) -> None:
        """Send targets until all is connected, and begin to count when none is on its way."""
        self._new_target()
        self._client.connect(self._newest(), ERROR)
        self._until_the_last_is_answered(Pose, self._client.target)
        for kind, publisher in self._publishers.items():
            self._until_the_last_is_answered(kind, publisher)
        self._count_from_here()

    def _count_from_here(self) -> None:
        """Begin to count, when no target is on its way."""
        # Reports may have waited to be taken. After these, the first may have been made before the
        # last target, and delivered after it.
        self._client.take_messages(1.0)
        for _ in range(2):
            _, values = self._client.wait_for_status(
                "ik_node", lambda values: "targets received" in values, "counts"
            )
        self._received = counts_in(values).received
        self._forget()

    def _until_the_last_is_answered(self, kind: type, publisher: Publisher) -> None:
        """Send one after the other on a publisher, until the last is answered.

        What one publisher sends comes in order. So nothing is on its way then, as the first ones
        may be for seconds, if the reader learns of its writer later than the other way round.
        """
        points = 1
        target = self._new_target()

        def send_another() -> None:
            nonlocal points, target
            points += 1
            target = self._new_target()
            if kind is PoseArray:
                publisher.publish(path_message([target] * points))
            else:
                publisher.publish(self._message(kind, target))

        def is_answered() -> bool:
            if kind is not PoseArray:
                return bool(self._client.stamps_of(target))
            trajectories = self._client.received["joint_trajectory"]
            return any(len(answer.points) == points for answer in trajectories)

        self._client.repeat_until(
            send_another, is_answered, f"an answer to a {kind.__name__}", pause=1.0
        )

    def _new_target(self) -> FloatArray:
        self.sent += 1
        target = good_target(self.sent % 90_000)
        self._good[float(target[0])] = target
        return target

    def _newest(self) -> FloatArray:
        return list(self._good.values())[-1]

    @staticmethod
    def _message(kind: type, target: FloatArray) -> bytes:
        return bytes(serialize_message(message_of(kind, [target], "base_link")))

    def _send_good(self, kind: type = Pose) -> None:
        self._publishers[kind].publish(self._message(kind, self._new_target()))
        self._received += 1

    def _send_bad(self) -> None:
        bad = UNREACHABLE.copy()
        if self._random.random() < 0.5:
            bad[self._random.randrange(7)] = self._random.choice([math.nan, math.inf, 1e300])
        self._publishers[Pose].publish(pose_from_array(bad))
        self.sent += 1
        self._received += 1

    def _follow_a_path(self) -> None:
        for _ in range(100):
            self._send_good(self._random.choice([Pose, PoseStamped]))
            self._client.take_messages(0.002)

    def _send_fuzzed_targets(self) -> None:
        for kind, publisher in self._publishers.items():
            longest = 60 if kind is Pose else 5000
            for data in mutated(kind, GOOD, 300, self._random.randrange(2**31), longest):
                publisher.publish(data)
                self._fuzzed.append(data)
                self.sent += 1
                self._received += 1

    def _flood(self) -> None:
        for _ in range(BURST):
            self._send_bad()
            self._send_good()

    def _send_paths(self) -> None:
        path = [GOOD, *diagonal_path()]
        for poses in (path, [*path, UNREACHABLE], [], [GOOD] * 1001, path):
            self._publishers[PoseArray].publish(path_message(poses))
            self.sent += 1
            self._received += 1

    def _be_silent(self) -> None:
        self._client.take_messages(self._random.uniform(0.5, 3.0))
        for _ in range(BURST):
            self._send_good()

    def _publish_from_two_sides(self) -> None:
        other = Client(self._domain)
        try:
            other.wait_until(other.target.get_subscription_count, "a reader of the targets")
            # The reader may know of it a moment later; what comes before that is lost.
            self._until_the_last_is_answered(Pose, other.target)
            self._count_from_here()
            for _ in range(50):
                other.target.publish(pose_from_array(self._new_target()))
                self._received += 1
                self._send_good()
            last = self._newest()
            self._client.wait_for_results(last, ["joint_command"])
            other.wait_until(
                lambda: (
                    len(self._client.received["accepted_target"]) >= 100
                    or self._client.take_messages(0.05)
                ),
                "all answers",
            )
        finally:
            other.close()

    def _publish_with_best_effort(self) -> None:
        """The node hears it after a while; what it loses until then and by it does not count."""
        publisher = self._client.node.create_publisher(
            Pose, "target_pose", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        )
        self._client.wait_until(publisher.get_subscription_count, "the node hears it")
        for _ in range(20):
            publisher.publish(pose_from_array(self._new_target()))
            self._client.take_messages(0.01)
        self._client.node.destroy_publisher(publisher)
        # Until then the node may lose targets of a burst, as it has said.
        node = self._processes["ik_node"]
        times = node.log.count("best-effort delivery")
        node.wait_for_text("received reliably again", count=times)
        self._find_each_other()
        self.check()

    def _publish_broken_joint_states(self) -> None:
        for _ in range(100):
            self._states.publish(b"\x00\x01\x00\x00" + self._random.randbytes(17))
            self._send_good()

    def _spoil_the_model(self) -> None:
        how = self._random.choice(["truncated", "removed", "overwritten"])
        if how == "removed":
            self._model.unlink()
        elif how == "truncated":
            os.truncate(self._model, self._random.randrange(1000))
        else:
            self._model.write_bytes(b"no model")
        self._send_good()
        assert not self._client.call("ik_node/reload_model").success, how
        self._send_good()
        self._restore_model()
        assert self._client.call("ik_node/reload_model").success

    def _restore_model(self) -> None:
        shutil.copy(default_model_path(), self._model)

    def _set_bad_parameters(self) -> None:
        for name, value in (
            ("max_joint_step", -1.0),
            ("max_joint_velocity", math.nan),
            ("workspace_box_lower", [math.inf] * 3),
            ("first_command", "perhaps"),
            ("max_path_poses", 0),
            ("queue_depth", 1),
            ("no_such_parameter", 1),
        ):
            assert not self._client.set_parameter("ik_node", name, value).successful, name
            self._send_good()

    def _change_limits(self) -> None:
        everything = [-math.inf] * 3, [math.inf] * 3
        box = {"workspace_box_lower": [5.0] * 3, "workspace_box_upper": [6.0] * 3}
        open_box = dict(zip(box, everything, strict=True))
        for values, accepted in ((box, False), (open_box, True), ({"max_newton_steps": 5}, True)):
            assert self._client.set_parameters_atomically("ik_node", values).successful
            target = self._new_target()
            self._publishers[Pose].publish(pose_from_array(target))
            self._received += 1
            self._send_bad()
            if accepted:
                self._client.wait_for_results(target, ["joint_command"])
        assert self._client.set_parameter("ik_node", "max_newton_steps", 10).successful

    def _ask_for_the_impossible(self) -> None:
        for transition in ("activate", "configure", "cleanup", "nonsense", 2, 77, 255):
            assert not self._client.change_state("ik_node", transition), transition
            self._send_good()

    def _deactivate(self) -> None:
        assert self._client.change_state("ik_node", "deactivate")
        for _ in range(50):
            self._send_good()
        self._check_counts()
        assert self._client.change_state("ik_node", "activate")

    def _configure_anew(self) -> None:
        # What is under way is lost with the publishers that are taken down.
        self.check()
        for transition in ("deactivate", "cleanup", "configure", "activate"):
            assert self._client.change_state("ik_node", transition), transition
        self._find_each_other()

    def _simulate_time(self) -> None:
        self._client.wait_for_status("ik_node", lambda _: True, "any state")
        assert self._client.set_parameter("ik_node", "use_sim_time", True).successful
        for _ in range(10):
            message = Clock()
            message.clock.sec = self._random.randrange(2**31 - 10)
            self._clock.publish(message)
            self._client.take_messages(0.02)
            for _ in range(5):
                self._send_good()
        assert self._client.set_parameter("ik_node", "use_sim_time", False).successful

    def _stop(self, name: str) -> None:
        self._processes[name].signal(signal.SIGSTOP)
        for _ in range(BURST // 2):
            self._send_good()
            self._send_bad()
        self._client.take_messages(self._random.uniform(0.0, 1.0))
        self._processes[name].signal(signal.SIGCONT)

    def _kill_the_ik_node(self) -> None:
        self._follow_a_path()
        self._processes["ik_node"].kill()
        # The last command may have gone out, and its target not.
        self._client.take_the_rest()
        assert_all_numbers_finite(self._client)
        self._forget()
        self._start("ik_node")
        self._find_each_other()

    def _kill_the_robot(self) -> None:
        self._follow_a_path()
        self._processes["fake_robot"].kill()
        self._follow_a_path()
        self._client.wait_for_results(self._newest(), ["joint_command"])
        self._check_commands()
        self._start("fake_robot")
        self._find_each_other()

    def _record(self) -> None:
        bag = self._folder / f"bag_{self._started}"
        self._started += 1
        arguments = "-p", f"output:={bag}", "-p", "topics:=[target_pose, joint_command]"
        log = self._folder / f"{self._started:04}_bag_recorder.log"
        recorder = NodeProcess("bag_recorder", arguments, self._domain, log)
        try:
            recorder.wait_for_text("recording 2 topics")

            def recorded() -> bool:
                # It may know of the publishers a moment after it is ready.
                self._follow_a_path()
                self._client.take_messages(0.1)
                return any(True for _ in read_bag(bag).records())

            self._client.wait_until(recorded, "something in the bag")
            how = self._random.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
            recorder.signal(how)
            code = recorder.wait_for_exit()
            assert code == (-how if how is signal.SIGKILL else 0), f"exit code {code}"
            assert sum(1 for _ in read_bag(bag).records()) > 0, "the bag is empty"
        finally:
            recorder.kill()
        shutil.rmtree(bag)


def parsed(arguments: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="./run soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="how long (default: 20)")
    parser.add_argument("--seed", type=int, help="of the order of the faults (default: any)")
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> int:
    """Run for a while; 0 if nothing was found, 1 after a line on what was."""
    options = parsed(arguments)
    seed = options.seed if options.seed is not None else random.SystemRandom().randrange(2**31)
    with reserved_domain() as domain:
        return run(seed, options.minutes, domain)


def run(seed: int, minutes: float, domain: int) -> int:
    """Run for some minutes in a ROS domain; returns the exit code."""
    folder = Path(tempfile.mkdtemp(prefix="annik_soak_"))
    print(f"seed {seed}, {minutes:g} minutes, logs in {folder}", flush=True)
    start = time.monotonic()
    done: Counter[str] = Counter()
    name, soak = "start", None
    try:
        soak = Soak(seed, folder, domain)
        soak.check()
        # One fault at least, however long the start took.
        while not done or time.monotonic() - start < 60 * minutes:
            for name in soak.order():
                soak.faults[name]()
                soak.check()
                done[name] += 1
                seconds = time.monotonic() - start
                print(f"[{seconds:7.1f} s] {name}: survived", flush=True)
                if seconds >= 60 * minutes:
                    break
    # A finding of pytest's is no Exception.
    except (Exception, pytest.fail.Exception) as finding:
        traceback.print_exc()
        print(f"FOUND by {name!r} after {time.monotonic() - start:.1f} s: {finding}")
        print(f"find it again: ./run soak --seed {seed}; the logs are in {folder}")
        return 1
    finally:
        if soak is not None:
            soak.close()
    shutil.rmtree(folder)
    print(f"{sum(done.values())} faults, {soak.sent} targets, nothing found (seed {seed}):")
    for name, count in sorted(done.items()):
        print(f"  {count:5} {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

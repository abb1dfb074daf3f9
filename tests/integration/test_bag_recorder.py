"""The recorder as a process on real DDS: what it keeps, and how it ends."""

from __future__ import annotations

import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from msg_tools.bags.reader import read_bag

pytestmark = pytest.mark.ros

DOMAIN = str(os.getpid() % 102)
ENVIRONMENT = {
    **os.environ,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_DOMAIN_ID": DOMAIN,
    "ROS_PYTHON_CHECK_FIELDS": "1",
    "PYTHONUNBUFFERED": "1",
}
START_TIMEOUT = 20.0
#: A node ends within this time of its signal [s].
END_TIMEOUT = 2.0

# Publishes position.x = 0, 1, 2, ... and prints each number once it is out.
PUBLISHER = """
import sys, time
import rclpy
from geometry_msgs.msg import Pose
from rclpy.qos import QoSProfile, ReliabilityPolicy
topic, rate, count, reliability = sys.argv[1:5]
rclpy.init(args=sys.argv)
node = rclpy.create_node("publisher")
qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability])
publisher = node.create_publisher(Pose, topic, qos)
deadline = time.monotonic() + 15
while publisher.get_subscription_count() < 1 and time.monotonic() < deadline:
    time.sleep(0.02)
message = Pose()
for number in range(int(count)):
    message.position.x = float(number)
    publisher.publish(message)
    print(number, time.time_ns(), flush=True)
    time.sleep(1 / float(rate))
sys.stdin.read()
"""


class Process:
    """A process in a group of its own, whose output is collected line by line."""

    def __init__(self, *command: str, cwd: Path, file_size_limit: int | None = None) -> None:
        def limit() -> None:
            if file_size_limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (file_size_limit, file_size_limit))

        self.popen = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=cwd,
            env=ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(sys.path)},
            start_new_session=True,
            preexec_fn=limit,
        )
        self.lines: list[str] = []
        self.changed = threading.Condition()
        self.thread = threading.Thread(target=self._collect, daemon=True)
        self.thread.start()

    def _collect(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            with self.changed:
                self.lines.append(line.rstrip())
                self.changed.notify_all()

    def wait_for(self, pattern: str, timeout: float = START_TIMEOUT) -> None:
        with self.changed:
            found = self.changed.wait_for(
                lambda: any(re.search(pattern, line) for line in self.lines), timeout
            )
        assert found, f"no {pattern!r} in {self.lines}"

    def end(self, signal_number: int) -> int:
        self.popen.send_signal(signal_number)
        return self.wait()

    def wait(self, timeout: float = END_TIMEOUT) -> int:
        code = self.popen.wait(timeout)
        self.thread.join(timeout)
        return code

    def kill(self) -> None:
        if self.popen.poll() is None:
            os.killpg(self.popen.pid, signal.SIGKILL)
            self.popen.wait(END_TIMEOUT)


Start = Callable[..., Process]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts processes and kills at the end those that still run."""
    processes: list[Process] = []

    def start_process(*command: str, file_size_limit: int | None = None) -> Process:
        processes.append(Process(*command, cwd=tmp_path, file_size_limit=file_size_limit))
        return processes[-1]

    yield start_process
    for process in processes:
        process.kill()


def start_recorder(
    start: Start, *parameters: str, remaps: tuple[str, ...] = (), **options: int
) -> Process:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    arguments += [word for remap in remaps for word in ("-r", remap)]
    return start("-m", "annik_ros.bag_recorder.node", "--ros-args", *arguments, **options)


def start_publisher(
    start: Start,
    topic: str = "target_pose",
    *,
    rate: float = 200,
    count: int = 100,
    reliability: str = "RELIABLE",
) -> Process:
    return start("-c", PUBLISHER, topic, str(rate), str(count), reliability)


def recorded_numbers(path: Path, topic: str = "/target_pose") -> list[float]:
    return [record.message.position.x for record in read_bag(path).records({topic})]


def wait_until(condition: Callable[[], bool], timeout: float = START_TIMEOUT) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_all_messages_are_recorded_and_a_signal_closes_the_bag(
    start: Start, tmp_path: Path, signal_number: int
) -> None:
    recorder = start_recorder(start, "output:=bag")
    recorder.wait_for("recording 13 topics to bag")
    start_publisher(start, count=100).wait_for(r"^99 ")
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) == 100)
    assert recorder.end(signal_number) == 0
    assert "Traceback" not in "\n".join(recorder.lines)
    assert any("recorded 100 messages to bag" in line for line in recorder.lines)

    bag = read_bag(tmp_path / "bag")
    assert bag.complete
    assert bag.has_publish_times
    records = list(bag.records())
    assert [record.message.position.x for record in records] == list(range(100))
    for record in records:
        assert 0 < record.log_time_ns - record.publish_time_ns < 5e9
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 100
        (connection,) = reader.connections
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability.name == "RELIABLE"


def test_a_killed_recorder_leaves_a_bag_that_opens(start: Start, tmp_path: Path) -> None:
    recorder = start_recorder(start, "output:=bag")
    recorder.wait_for("recording")
    publisher = start_publisher(start, rate=200, count=400)
    publisher.wait_for(r"^350 ")
    killed_at = time.time_ns()
    recorder.end(signal.SIGKILL)
    sent = [int(line.split()[1]) for line in publisher.lines if re.match(r"\d+ \d+$", line)]
    surely_kept = sum(killed_at - time_ns > 10**9 for time_ns in sent)
    assert surely_kept > 50

    bag = read_bag(tmp_path / "bag")
    assert not bag.complete
    numbers = recorded_numbers(tmp_path / "bag")
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= surely_kept
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == len(numbers)


@pytest.mark.parametrize("publisher_first", [True, False])
def test_best_effort_publishers_are_recorded_whenever_they_come(
    start: Start, tmp_path: Path, publisher_first: bool
) -> None:
    if publisher_first:
        publisher = start_publisher(start, reliability="BEST_EFFORT", count=60)
        recorder = start_recorder(start, "output:=bag")
    else:
        recorder = start_recorder(start, "output:=bag")
        recorder.wait_for("recording")
        publisher = start_publisher(start, reliability="BEST_EFFORT", count=60)
    publisher.wait_for(r"^59 ")
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) > 0)
    assert recorder.end(signal.SIGINT) == 0


def test_names_are_resolved_and_unknown_types_learned(start: Start, tmp_path: Path) -> None:
    recorder = start_recorder(
        start,
        "output:=bag",
        "topics:=['target_pose', 'mine', '/far/away']",
        remaps=("__ns:=/cell", "mine:=yours"),
    )
    recorder.wait_for("waiting for a publisher of .*/cell/yours")
    publishers = [
        start_publisher(start, topic, count=20)
        for topic in ("/cell/target_pose", "/cell/yours", "/far/away")
    ]
    recorder.wait_for("recording 3 topics")
    for publisher in publishers:
        publisher.wait_for(r"^19 ")
    expected = {"/cell/target_pose": 20, "/cell/yours": 20, "/far/away": 20}

    def counts() -> dict[str, int]:
        return {t.name: t.message_count for t in read_bag(tmp_path / "bag").topics.values()}

    wait_until(lambda: counts() == expected)
    assert recorder.end(signal.SIGTERM) == 0
    assert counts() == expected


def test_recording_for_a_duration_ends_by_itself(start: Start, tmp_path: Path) -> None:
    recorder = start_recorder(start, "output:=bag", "duration:=0.5")
    recorder.wait_for("recording")
    assert recorder.wait(START_TIMEOUT) == 0
    assert read_bag(tmp_path / "bag").complete


def test_the_default_output_is_a_dated_folder(start: Start, tmp_path: Path) -> None:
    recorder = start_recorder(start, "duration:=0.1")
    assert recorder.wait(START_TIMEOUT) == 0
    (bag,) = tmp_path.glob("annik_bag_*")
    assert read_bag(bag).complete


@pytest.mark.parametrize(
    ("parameter", "complaint"),
    [
        ("output:=occupied", "not empty"),
        ("output:=occupied/file/bag", "occupied/file/bag can't be written"),
        ("topics:=['no topic']", "Invalid topic name"),
        ("duration:=soon", "duration"),
        ("duration:=-1.0", "duration"),
    ],
)
def test_wrong_parameters_are_one_error_and_exit_code_1(
    start: Start, tmp_path: Path, parameter: str, complaint: str
) -> None:
    (tmp_path / "occupied").mkdir()
    (tmp_path / "occupied" / "file").write_text("mine")
    recorder = start_recorder(start, parameter)
    assert recorder.wait(START_TIMEOUT) == 1
    output = "\n".join(recorder.lines)
    assert "Traceback" not in output
    assert output.count("FATAL") == 1
    assert complaint in output
    assert [path.name for path in (tmp_path / "occupied").iterdir()] == ["file"]


def test_a_wrong_command_line_is_one_error_and_exit_code_1(start: Start) -> None:
    recorder = start_recorder(start, "output")
    assert recorder.wait(START_TIMEOUT) == 1
    output = "\n".join(recorder.lines)
    assert "Traceback" not in output
    assert output.count("FATAL") == 1
    assert "output" in output


def test_a_type_that_is_not_installed_does_not_keep_the_others_from_being_recorded(
    start: Start, tmp_path: Path
) -> None:
    # An empty package where the recorder starts hides the real one from it.
    (tmp_path / "shape_msgs").mkdir()
    (tmp_path / "shape_msgs" / "__init__.py").write_text("")
    publisher = start(
        "-c",
        "import sys; sys.path.remove('')\n"
        "import rclpy; from shape_msgs.msg import Plane\n"
        "rclpy.init(); node = rclpy.create_node('other')\n"
        "publisher = node.create_publisher(Plane, 'planes', 1)\n"
        "print('ready', flush=True); sys.stdin.read()",
    )
    publisher.wait_for("ready")
    recorder = start_recorder(start, "output:=bag", "topics:=['planes', 'target_pose']")
    recorder.wait_for("recording 1 topics to bag")
    start_publisher(start, count=20).wait_for(r"^19 ")
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) == 20)
    assert recorder.end(signal.SIGINT) == 0
    output = "\n".join(recorder.lines)
    assert "Traceback" not in output
    assert output.count("/planes is not recorded: shape_msgs/msg/Plane is not installed") == 1


def test_a_full_disk_ends_the_recording_and_keeps_what_there_is(
    start: Start, tmp_path: Path
) -> None:
    recorder = start_recorder(start, "output:=bag", file_size_limit=30_000)
    recorder.wait_for("recording")
    start_publisher(start, rate=500, count=2000)
    assert recorder.wait(START_TIMEOUT) == 1
    output = "\n".join(recorder.lines)
    assert "Traceback" not in output
    assert output.count("recording stopped") == 1
    numbers = recorded_numbers(tmp_path / "bag")
    assert len(numbers) > 50
    assert numbers == list(range(len(numbers)))
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == len(numbers)

"""The recorder as a process on real DDS: what it keeps, and how it ends."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader
from support.nodes import NodeProcess
from support.processes import EXIT_PATIENCE, PATIENCE, Process, wait_until

from msg_tools.bags.reader import read_bag
from msg_tools.topics import TOPICS

# Publishes position.x = 0, 1, 2, ... and prints each number once it is out.
PUBLISHER = """
import signal, sys, time
import rclpy
from geometry_msgs.msg import Pose
from rclpy.qos import QoSProfile, ReliabilityPolicy
topic, rate, count, reliability, patience = sys.argv[1:6]
rclpy.init(args=sys.argv)
node = rclpy.create_node("publisher")
qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy[reliability])
publisher = node.create_publisher(Pose, topic, qos)
deadline = time.monotonic() + float(patience)
while publisher.get_subscription_count() < 1 and time.monotonic() < deadline:
    time.sleep(0.02)
message = Pose()
for number in range(int(count)):
    message.position.x = float(number)
    publisher.publish(message)
    print(number, time.time_ns(), flush=True)
    time.sleep(1 / float(rate))
signal.pause()
"""


class Recording:
    """Starts a recorder in the folder of the test, and publishers that it hears.

    Args:
        folder: working directory of the processes.
        domain: ROS domain.
    """

    def __init__(self, folder: Path, domain: int) -> None:
        self.processes: list[Process] = []
        self._domain = domain
        # A recorder hears what is installed where it starts.
        self._options = {"cwd": folder}
        self._python_path = {"PYTHONPATH": os.pathsep.join(sys.path)}

    def recorder(
        self, *parameters: str, remaps: tuple[str, ...] = (), file_size_limit: int | None = None
    ) -> NodeProcess:
        arguments = [word for parameter in parameters for word in ("-p", parameter)]
        arguments += [word for remap in remaps for word in ("-r", remap)]
        self.processes.append(
            NodeProcess(
                "bag_recorder",
                tuple(arguments),
                self._domain,
                self._log("recorder"),
                self._python_path,
                file_size_limit=file_size_limit,
                **self._options,
            )
        )
        return self.processes[-1]

    def publisher(
        self,
        topic: str = "target_pose",
        *,
        rate: float = 200,
        count: int = 100,
        reliability: str = "RELIABLE",
    ) -> Process:
        arguments = (topic, str(rate), str(count), reliability, str(PATIENCE))
        return self.script(PUBLISHER, *arguments)

    def script(self, text: str, *arguments: str) -> Process:
        environment = {**self._python_path, "ROS_DOMAIN_ID": str(self._domain)}
        command = (sys.executable, "-c", text, *arguments)
        log = self._log("script")
        self.processes.append(Process(*command, log=log, environment=environment, **self._options))
        return self.processes[-1]

    def _log(self, name: str) -> Path:
        return self._options["cwd"] / f"{len(self.processes)}_{name}.log"


@pytest.fixture
def recording(tmp_path: Path, domain: int) -> Iterator[Recording]:
    """Starts processes, and kills them at the end."""
    recording = Recording(tmp_path, domain)
    yield recording
    for process in recording.processes:
        process.kill()


def published(publisher: Process, count: int) -> None:
    """Wait until a publisher has published so many messages."""
    publisher.wait_for_text(f"\n{count - 1} ")


def end(process: Process, number: int) -> int:
    """The exit code after a signal, which has to come soon."""
    process.signal(number)
    return process.wait_for_exit(EXIT_PATIENCE)


def recorded_numbers(path: Path, topic: str = "/target_pose") -> list[float]:
    return [record.message.position.x for record in read_bag(path).records({topic})]


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_all_messages_are_recorded_and_a_signal_closes_the_bag(
    recording: Recording, tmp_path: Path, signal_number: int
) -> None:
    recorder = recording.recorder("output:=bag")
    recorder.wait_for_text(f"recording {len(TOPICS)} topics to bag")
    publisher = recording.publisher(count=100)
    published(publisher, 100)
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) == 100, "all messages in the bag")
    in_the_bag = time.time_ns()
    assert end(recorder, signal_number) == 0
    assert "Traceback" not in recorder.log
    assert "recorded 100 messages to bag" in recorder.log

    bag = read_bag(tmp_path / "bag")
    assert bag.complete
    assert bag.has_publish_times
    records = list(bag.records())
    assert [record.message.position.x for record in records] == list(range(100))
    # The publisher prints the time after each message.
    printed = [int(time) for time in re.findall(r"^\d+ (\d+)$", publisher.log, re.MULTILINE)]
    assert len(printed) == 100
    for record, before, after in zip(records, [0, *printed], printed, strict=False):
        assert before < record.publish_time_ns < after
        assert record.publish_time_ns < record.log_time_ns < in_the_bag
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 100
        (connection,) = reader.connections
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability.name == "RELIABLE"


def test_a_killed_recorder_leaves_a_bag_that_opens(recording: Recording, tmp_path: Path) -> None:
    recorder = recording.recorder("output:=bag")
    recorder.wait_for_text("recording")
    publisher = recording.publisher(rate=200, count=100_000)
    published(publisher, 100)
    bag = tmp_path / "bag"
    # A second on an idle machine; the messages are too few to fill a chunk.
    wait_until(lambda: len(recorded_numbers(bag)) >= 100, "100 messages on the disk", 10.0)
    kept = len(recorded_numbers(bag))
    assert end(recorder, signal.SIGKILL) == -signal.SIGKILL

    assert not read_bag(bag).complete
    numbers = recorded_numbers(bag)
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= kept
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == len(numbers)


@pytest.mark.parametrize("publisher_first", [True, False])
def test_best_effort_publishers_are_recorded_whenever_they_come(
    recording: Recording, tmp_path: Path, publisher_first: bool
) -> None:
    # It goes on: what is sent before the recorder knows the publisher is lost.
    if publisher_first:
        recording.publisher(reliability="BEST_EFFORT", count=100_000)
    recorder = recording.recorder("output:=bag")
    recorder.wait_for_text("recording")
    if not publisher_first:
        recording.publisher(reliability="BEST_EFFORT", count=100_000)
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) > 0, "a message in the bag")
    assert end(recorder, signal.SIGINT) == 0


#: Publishes one message for whoever comes later, and waits to be ended.
LATCHED = """
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("describer")
qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
publisher = node.create_publisher(String, "robot_description", qos)
publisher.publish(String(data="<robot/>"))
print("published", flush=True)
rclpy.spin(node)
"""


@pytest.mark.parametrize("description_first", [True, False])
def test_a_description_that_was_published_once_is_recorded(
    recording: Recording, tmp_path: Path, description_first: bool
) -> None:
    if description_first:
        recording.script(LATCHED).wait_for_text("published")
    recorder = recording.recorder("output:=bag")
    recorder.wait_for_text("recording")
    if not description_first:
        recording.script(LATCHED)
    topics = {"/robot_description"}
    wait_until(lambda: list(read_bag(tmp_path / "bag").records(topics)), "the description")
    assert end(recorder, signal.SIGINT) == 0


def test_names_are_resolved_and_unknown_types_learned(
    recording: Recording, tmp_path: Path
) -> None:
    recorder = recording.recorder(
        "output:=bag",
        "topics:=['target_pose', 'mine', '/far/away']",
        remaps=("__ns:=/cell", "mine:=yours"),
    )
    wait_until(
        lambda: re.search("waiting for a publisher of .*/cell/yours", recorder.log),
        "the recorder waits for a topic of unknown type",
    )
    publishers = [
        recording.publisher(topic, count=20)
        for topic in ("/cell/target_pose", "/cell/yours", "/far/away")
    ]
    recorder.wait_for_text("recording 3 topics")
    for publisher in publishers:
        published(publisher, 20)
    expected = {"/cell/target_pose": 20, "/cell/yours": 20, "/far/away": 20}

    def counts() -> dict[str, int]:
        return {t.name: t.message_count for t in read_bag(tmp_path / "bag").topics.values()}

    wait_until(lambda: counts() == expected, "all messages in the bag")
    assert end(recorder, signal.SIGTERM) == 0
    assert counts() == expected


def test_recording_for_a_duration_ends_by_itself(recording: Recording, tmp_path: Path) -> None:
    recorder = recording.recorder("output:=bag", "duration:=0.5")
    recorder.wait_for_text("recording")
    assert recorder.wait_for_exit() == 0
    assert read_bag(tmp_path / "bag").complete


def test_the_default_output_is_a_dated_folder(recording: Recording, tmp_path: Path) -> None:
    recorder = recording.recorder("duration:=0.1")
    assert recorder.wait_for_exit() == 0
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
    recording: Recording, tmp_path: Path, parameter: str, complaint: str
) -> None:
    (tmp_path / "occupied").mkdir()
    (tmp_path / "occupied" / "file").write_text("mine")
    recorder = recording.recorder(parameter)
    assert recorder.wait_for_exit() == 1
    output = recorder.log
    assert "Traceback" not in output
    assert output.count("FATAL") == 1
    assert complaint in output
    assert [path.name for path in (tmp_path / "occupied").iterdir()] == ["file"]


def test_a_wrong_command_line_is_one_error_and_exit_code_1(recording: Recording) -> None:
    recorder = recording.recorder("output")
    assert recorder.wait_for_exit() == 1
    output = recorder.log
    assert "Traceback" not in output
    assert output.count("FATAL") == 1
    assert "output" in output


def test_a_type_that_is_not_installed_does_not_keep_the_others_from_being_recorded(
    recording: Recording, tmp_path: Path
) -> None:
    # An empty package where the recorder starts hides the real one from it.
    (tmp_path / "shape_msgs").mkdir()
    (tmp_path / "shape_msgs" / "__init__.py").write_text("")
    publisher = recording.script(
        "import signal, sys; sys.path.remove('')\n"
        "import rclpy; from shape_msgs.msg import Plane\n"
        "rclpy.init(); node = rclpy.create_node('other')\n"
        "publisher = node.create_publisher(Plane, 'planes', 1)\n"
        "print('ready', flush=True); signal.pause()"
    )
    publisher.wait_for_text("ready")
    recorder = recording.recorder("output:=bag", "topics:=['planes', 'target_pose']")
    recorder.wait_for_text("recording 1 topics to bag")
    published(recording.publisher(count=20), 20)
    wait_until(lambda: len(recorded_numbers(tmp_path / "bag")) == 20, "all messages in the bag")
    assert end(recorder, signal.SIGINT) == 0
    output = recorder.log
    assert "Traceback" not in output
    assert output.count("/planes is not recorded: shape_msgs/msg/Plane is not installed") == 1


def test_a_full_disk_ends_the_recording_and_keeps_what_there_is(
    recording: Recording, tmp_path: Path
) -> None:
    recorder = recording.recorder("output:=bag", file_size_limit=30_000)
    recorder.wait_for_text("recording")
    recording.publisher(rate=500, count=2000)
    assert recorder.wait_for_exit() == 1
    output = recorder.log
    assert "Traceback" not in output
    assert output.count("recording stopped") == 1
    numbers = recorded_numbers(tmp_path / "bag")
    assert len(numbers) > 50
    assert numbers == list(range(len(numbers)))
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == len(numbers)

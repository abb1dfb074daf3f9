"""Reading gives everything before the damage, and never fails in an unforeseen way."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from support.robot_recording import START_NS, RobotRecording, make

from msg_tools.bags.errors import BagNotFound, BagNotReadable
from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.reader import read_bag
from msg_tools.bags.writer import BagWriter

POINT = "geometry_msgs/msg/Point"
CHUNK_COUNT = 12
MESSAGES_PER_CHUNK = 5


def write_metadata(bag: Path, files: Sequence[str], counts: Mapping[str, int]) -> None:
    topics = [
        {"topic_metadata": {"name": name, "type": POINT}, "message_count": count}
        for name, count in counts.items()
    ]
    information = {
        "version": 9,
        "relative_file_paths": list(files),
        "message_count": sum(counts.values()),
        "topics_with_message_count": topics,
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information})
    (bag / "metadata.yaml").write_text(text)


def point_cdr(number: float) -> bytes:
    return bytes(jazzy_types().serialize_cdr(make(POINT, x=number, y=0.0, z=0.0), POINT))


@pytest.fixture(scope="module")
def chunked(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[int]]:
    """A closed file and where each of its chunks ends."""
    directory = tmp_path_factory.mktemp("chunked") / "bag"
    ends = []
    with BagWriter(directory) as writer:
        writer.add_topic("/point", POINT)
        for number in range(CHUNK_COUNT * MESSAGES_PER_CHUNK):
            writer.write("/point", point_cdr(number), START_NS + number, START_NS + number)
            if number % MESSAGES_PER_CHUNK == MESSAGES_PER_CHUNK - 1:
                writer.flush()
                ends.append((directory / "bag_0.mcap").stat().st_size - 50)
    return (directory / "bag_0.mcap").read_bytes(), ends


def rosbags_bag(
    path: Path,
    recording: RobotRecording,
    plugin: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {message.topic: message.type for message in recording.messages}
        opened = {
            topic: writer.add_connection(topic, kind, typestore=jazzy_types())
            for topic, kind in connections.items()
        }
        for message in recording.messages:
            writer.write(opened[message.topic], message.log_time_ns, message.cdr)
    return path


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_cut_loses_nothing_before_it(
    data: st.DataObject, chunked: tuple[bytes, list[int]], tmp_path: Path
) -> None:
    content, ends = chunked
    size = data.draw(st.integers(0, len(content) - 1))
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[:size])
    whole_chunks = sum(end <= size for end in ends)
    try:
        bag = read_bag(path)
    except BagNotReadable:
        assert size < 8
        return
    values = [record.message.x for record in bag.records()]
    assert values == list(range(len(values)))
    assert len(values) >= whole_chunks * MESSAGES_PER_CHUNK
    assert bag.message_count == len(values)
    assert not bag.complete
    assert bag.damage


def test_a_cut_last_byte_is_noticed(chunked: tuple[bytes, list[int]], tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(chunked[0][:-1])
    bag = read_bag(path)
    assert not bag.complete
    assert bag.message_count == CHUNK_COUNT * MESSAGES_PER_CHUNK


def test_messages_inside_a_cut_chunk_are_read(
    chunked: tuple[bytes, list[int]], tmp_path: Path
) -> None:
    content, ends = chunked
    path = tmp_path / "cut.mcap"
    # The message index behind the last chunk is shorter than this, a message is longer than that.
    path.write_bytes(content[: ends[-1] - 150])
    assert read_bag(path).message_count == CHUNK_COUNT * MESSAGES_PER_CHUNK - 1


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_altered_bytes_are_never_an_unforeseen_error(
    data: st.DataObject, chunked: tuple[bytes, list[int]], tmp_path: Path
) -> None:
    content = bytearray(chunked[0])
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "altered.mcap"
    path.write_bytes(content)
    try:
        bag = read_bag(path)
        for record in bag.records():
            # An altered length makes a chunk look cut: that is said, and its bytes are unchecked.
            assert record.type == POINT or bag.damage
    except BagNotReadable:
        pass


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.binary(max_size=300))
def test_any_bytes_are_never_an_unforeseen_error(content: bytes, tmp_path: Path) -> None:
    for name in ("noise.mcap", "noise.db3"):
        (tmp_path / name).write_bytes(content)
        try:
            read_bag(tmp_path / name)
        except BagNotReadable as error:
            assert error.path.name == name


def test_a_damaged_chunk_is_left_out_and_the_others_are_read(
    chunked: tuple[bytes, list[int]], tmp_path: Path
) -> None:
    content = bytearray(chunked[0])
    content[chunked[1][5] - 200] ^= 0xFF
    path = tmp_path / "altered.mcap"
    path.write_bytes(content)
    bag = read_bag(path)
    assert bag.message_count == (CHUNK_COUNT - 1) * MESSAGES_PER_CHUNK
    assert "checksum" in bag.damage[0]


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize(
    "compression", [CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE]
)
def test_bags_of_others_are_read(
    tmp_path: Path, plugin: StoragePlugin, compression: CompressionMode
) -> None:
    recording = RobotRecording(count=4)
    bag = read_bag(rosbags_bag(tmp_path / "bag", recording, plugin, compression))
    assert bag.complete
    assert not bag.has_publish_times
    assert bag.message_count == len(recording.messages)
    targets = [r.message.position.x for r in bag.records({"/target_pose"})]
    assert targets == [recording.target(number)[0] for number in range(4)]


def test_a_chunk_compressed_bag_is_read(tmp_path: Path) -> None:
    recording = RobotRecording(count=4)
    path = rosbags_bag(tmp_path / "bag", recording, StoragePlugin.MCAP, CompressionMode.STORAGE)
    bag = read_bag(path)
    assert bag.complete
    assert bag.message_count == len(recording.messages)


def test_a_bare_file_is_read(tmp_path: Path) -> None:
    recording = RobotRecording(count=3)
    (mcap,) = recording.write(tmp_path / "ours").glob("*.mcap")
    assert read_bag(mcap).complete
    (db3,) = rosbags_bag(tmp_path / "theirs", recording, StoragePlugin.SQLITE3).glob("*.db3")
    assert read_bag(db3).message_count == len(recording.messages)


def test_a_split_bag_is_read_in_order_and_a_missing_part_is_told(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    names = [f"bag_{number}.mcap" for number in range(11)]
    for number, name in enumerate(names):
        with BagWriter(tmp_path / f"part_{number}") as writer:
            writer.add_topic("/point", POINT)
            writer.write("/point", point_cdr(number), START_NS + number, START_NS + number)
        shutil.copy(tmp_path / f"part_{number}" / f"part_{number}_0.mcap", bag / name)
    write_metadata(bag, names, {"/point": 11})
    assert [r.message.x for r in read_bag(bag).records()] == list(range(11))
    assert read_bag(bag).complete

    (bag / "bag_3.mcap").unlink()
    assert read_bag(bag).message_count == 10
    assert "bag_3.mcap" in read_bag(bag).damage[0]

    (bag / "metadata.yaml").unlink()
    assert [r.message.x for r in read_bag(bag).records()] == [0, 1, 2, *range(4, 11)]
    assert not read_bag(bag).complete


def test_one_unreadable_part_does_not_hide_the_others(tmp_path: Path) -> None:
    path = RobotRecording(count=3).write(tmp_path / "bag")
    (path / "bag_1.mcap").write_bytes(b"")
    bag = read_bag(path)
    assert bag.message_count == 21
    assert "bag_1.mcap" in bag.damage[0]


def test_metadata_of_any_content_does_not_keep_messages_from_being_read(tmp_path: Path) -> None:
    path = RobotRecording(count=3).write(tmp_path / "bag")
    for text in (
        *("", "[]", "a: [", "rosbag2_bagfile_information: 3", "\x00"),
        # A date that is none, a number that Python does not read, and no end of brackets.
        *("a: 2024-13-45", "a: " + 5000 * "9", 3000 * "["),
    ):
        (path / "metadata.yaml").write_text(text)
        bag = read_bag(path)
        assert bag.message_count == 21
        assert not bag.complete


@pytest.mark.parametrize("name", [300 * "a" + ".mcap", '"a\\0b"', "..", '""'])
def test_listed_files_that_can_not_exist_are_missing_ones(tmp_path: Path, name: str) -> None:
    path = RobotRecording(count=3).write(tmp_path / "bag")
    (path / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n  - {name}\n"
    )
    bag = read_bag(path)
    assert bag.message_count == 21
    assert "is missing" in bag.damage[0]


def test_types_that_jazzy_has_not_are_learned_from_the_bag(tmp_path: Path) -> None:
    with (tmp_path / "own.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("my_msgs/msg/Mine", "ros2msg", b"float64 value\n")
        broken = writer.register_schema("my_msgs/msg/Broken", "ros2msg", b"no type\n")
        for topic, number in (("/mine", schema), ("/broken", broken)):
            channel = writer.register_channel(topic, "cdr", number)
            data = b"\x00\x01\x00\x00" + b"\x00\x00\x00\x00\x00\x00\xf0\x3f"
            writer.add_message(channel, START_NS, data, START_NS)
        writer.finish()
    bag = read_bag(tmp_path / "own.mcap")
    (record,) = bag.records({"/mine"})
    assert record.message.value == 1.0
    with pytest.raises(BagNotReadable) as caught:
        list(bag.records({"/broken"}))
    assert "my_msgs/msg/Broken" in caught.value.problem


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagNotFound):
        read_bag(tmp_path / "nowhere")
    (tmp_path / "text.txt").write_text("hello")
    (tmp_path / "empty").mkdir()
    (tmp_path / "folder.mcap").mkdir()
    problems = {"empty": "no .mcap", "text.txt": "not a bag", "folder.mcap": "no .mcap"}
    for name, problem in problems.items():
        with pytest.raises(BagNotReadable) as caught:
            read_bag(tmp_path / name)
        assert caught.value.path == tmp_path / name
        assert problem in caught.value.problem


def test_a_cut_sqlite_bag_is_never_an_unforeseen_error(tmp_path: Path) -> None:
    path = rosbags_bag(tmp_path / "bag", RobotRecording(count=50), StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    content = file.read_bytes()
    for size in range(0, len(content), len(content) // 25):
        file.write_bytes(content[:size])
        try:
            assert read_bag(path).message_count <= 350
        except BagNotReadable:
            continue

"""A written bag is one that others open, at every moment of its life."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from textwrap import dedent

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader
from support.processes import run_python
from support.robot_recording import START_NS, RobotRecording, make

from annik_core.errors import NotWritable
from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.reader import read_bag
from msg_tools.bags.writer import BagWriter

POINT = "geometry_msgs/msg/Point"
FOREVER = QosTime(9223372036, 854775807)
QOS = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.BEST_EFFORT,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    FOREVER,
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


def point_cdr(number: float) -> bytes:
    return bytes(jazzy_types().serialize_cdr(make(POINT, x=number, y=0.0, z=0.0), POINT))


def test_a_bag_is_read_back_by_us_and_by_rosbags_and_mcap(tmp_path: Path) -> None:
    recording = RobotRecording(count=5)
    path = recording.write(tmp_path / "bag")

    bag = read_bag(path)
    assert bag.complete
    assert bag.damage == ()
    assert bag.has_publish_times
    records = list(bag.records())
    assert [(r.topic, r.type, r.log_time_ns, r.publish_time_ns) for r in records] == [
        (m.topic, m.type, m.log_time_ns, m.publish_time_ns) for m in recording.messages
    ]
    for record, message in zip(records, recording.messages, strict=True):
        assert jazzy_types().serialize_cdr(record.message, record.type) == message.cdr

    with Reader(path) as reader:
        assert reader.message_count == len(recording.messages)
        assert {c.topic for c in reader.connections} == {m.topic for m in recording.messages}
        in_order = sorted(recording.messages, key=lambda m: m.log_time_ns)
        assert [data for _, _, data in reader.messages()] == [m.cdr for m in in_order]

    (file,) = path.glob("*.mcap")
    with file.open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        assert len(list(decoded)) == len(recording.messages)


def test_only_the_wanted_topics_are_decoded(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/good", POINT)
        writer.add_topic("/bad", POINT)
        writer.write("/bad", b"no CDR", START_NS, START_NS)
        writer.write("/good", point_cdr(1.0), START_NS, START_NS)
    (record,) = read_bag(tmp_path / "bag").records({"/good"})
    assert record.message.x == 1.0


def test_metadata_is_that_of_rosbag2(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/point", POINT, [QOS])
        writer.write("/point", point_cdr(1.0), START_NS, START_NS - 5)
        writer.write("/point", point_cdr(2.0), START_NS + 70, START_NS + 60)
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    information = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert "&" not in text
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["bag_0.mcap"]
    assert information["starting_time"] == {"nanoseconds_since_epoch": START_NS}
    assert information["duration"] == {"nanoseconds": 70}
    assert information["message_count"] == 2
    assert information["ros_distro"] == "jazzy"
    (topic,) = information["topics_with_message_count"]
    assert topic["message_count"] == 2
    assert topic["topic_metadata"]["type"] == POINT
    assert topic["topic_metadata"]["type_description_hash"].startswith("RIHS01_")
    assert topic["topic_metadata"]["offered_qos_profiles"][0]["reliability"] == "best_effort"

    with Reader(tmp_path / "bag") as reader:
        (connection,) = reader.connections
        assert connection.ext.offered_qos_profiles == [QOS]
        assert len(list(reader.messages())) == 2

    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        (schema,) = reader.get_summary().schemas.values()
        assert (schema.name, schema.encoding) == (POINT, "ros2msg")
        assert b"float64 x" in schema.data


def test_a_bag_that_is_never_closed_opens_everywhere(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "open")
    writer.add_topic("/point", POINT, [QOS])
    for number in range(100):
        writer.write("/point", point_cdr(number), START_NS + number, START_NS + number - 1)
    writer.flush()
    left = tmp_path / "left"
    shutil.copytree(tmp_path / "open", left)
    writer.close()

    bag = read_bag(left)
    assert not bag.complete
    assert "killed" in bag.damage[0]
    assert [record.message.x for record in bag.records()] == list(range(100))
    with Reader(left) as reader:
        assert len(list(reader.messages())) == 100
    with (left / "open_0.mcap").open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == 100


def test_a_new_bag_opens_before_its_first_message(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag")
    assert read_bag(tmp_path / "bag").message_count == 0
    with Reader(tmp_path / "bag") as reader:
        assert list(reader.messages()) == []


def test_writing_flushes_by_itself_when_a_chunk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("msg_tools.bags.writer.FLUSH_INTERVAL", float("inf"))
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/point", POINT)
    for number in range(10_000):
        writer.write("/point", point_cdr(number), START_NS + number, START_NS + number)
    assert read_bag(tmp_path / "bag").message_count > 5_000


def test_writing_flushes_by_itself_after_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("msg_tools.bags.writer.CHUNK_SIZE", 2**30)
    monkeypatch.setattr("msg_tools.bags.writer.FLUSH_INTERVAL", 0.0)
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/point", POINT)
    writer.write("/point", point_cdr(1.0), START_NS, START_NS)
    assert read_bag(tmp_path / "bag").message_count == 1


def test_a_folder_with_content_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    with pytest.raises(NotWritable) as caught:
        BagWriter(tmp_path)
    assert caught.value.path == tmp_path
    assert "not empty" in caught.value.reason and "give another folder" in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    with BagWriter(tmp_path):
        pass
    assert read_bag(tmp_path).complete


@pytest.mark.parametrize("path", ["file/bag", "file"])
def test_a_folder_that_can_not_be_made_is_refused(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(NotWritable) as caught:
        BagWriter(tmp_path / path)
    assert caught.value.path == tmp_path / path
    assert caught.value.reason in (os.strerror(errno.ENOTDIR), os.strerror(errno.EEXIST))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(NotWritable):
        BagWriter(tmp_path / "locked")


def test_an_unknown_type_and_a_second_type_are_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        with pytest.raises(NotWritable) as caught:
            writer.add_topic("/mine", "my_msgs/msg/Mine")
        assert "my_msgs/msg/Mine" in caught.value.reason
        writer.add_topic("/point", POINT)
        writer.add_topic("/point", POINT)
        with pytest.raises(NotWritable) as caught:
            writer.add_topic("/point", "geometry_msgs/msg/Pose")
        assert "topic /point has the type geometry_msgs/msg/Point, not" in caught.value.reason


def test_a_closed_bag_takes_no_more(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic("/point", POINT)
    writer.close()
    writer.close()
    with pytest.raises(NotWritable) as caught:
        writer.write("/point", point_cdr(0), START_NS, START_NS)
    assert "closed" in caught.value.reason


@pytest.mark.process
def test_what_was_written_before_the_disk_was_full_is_kept(tmp_path: Path) -> None:
    program = dedent(
        f"""
        import resource, sys
        from pathlib import Path
        from annik_core.errors import NotWritable
        from msg_tools.bags.writer import BagWriter
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
        flushed = 0
        try:
            with BagWriter(Path(sys.argv[1])) as writer:
                writer.add_topic("/point", {POINT!r})
                for number in range(100_000):
                    writer.write("/point", {point_cdr(7.0)!r}, {START_NS} + number, {START_NS})
                    if number % 100 == 0:
                        writer.flush()
                        flushed = number + 1
        except NotWritable as error:
            print(flushed, error)
        """
    )
    output = run_python("-c", program, tmp_path / "bag").stdout
    assert os.strerror(errno.EFBIG) in output and "check free space" in output
    bag = read_bag(tmp_path / "bag")
    assert bag.message_count == int(output.split()[0]) > 1000
    assert not bag.complete
    with Reader(tmp_path / "bag") as reader:
        assert len(list(reader.messages())) == bag.message_count

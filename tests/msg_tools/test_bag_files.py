"""Every message of every file of a bag is read and counted, and none of its files is changed."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from support.bounded import MEGABYTE, bounded
from support.robot_recording import START_NS, RobotRecording
from test_bag_reader import POINT, point_cdr, rosbags_bag, write_metadata

from msg_tools.bags.errors import BagNotReadable
from msg_tools.bags.reader import Bag, read_bag

SENT = 5_000_000  #: time from sending to receiving [ns]


def mcap_file(
    path: Path,
    numbers: Sequence[int],
    topic: str = "/point",
    compression: CompressionType = CompressionType.NONE,
    chunk_size: int = 1024 * 1024,
) -> Path:
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=chunk_size)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(POINT, "ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n")
        channel = writer.register_channel(topic, "cdr", schema)
        for number in numbers:
            time = START_NS + number
            writer.add_message(channel, time, point_cdr(number), time - SENT)
        writer.finish()
    return path


def pack(path: Path, suffix: str = ".zstd") -> Path:
    packed = path.with_name(path.name + suffix)
    packed.write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    return packed


def numbers_of(bag: Bag) -> list[float]:
    return sorted(record.message.x for record in bag.records())


@pytest.fixture
def two_files(tmp_path: Path) -> Path:
    """A bag of 20 messages in two files."""
    bag = tmp_path / "bag"
    bag.mkdir()
    mcap_file(bag / "bag_0.mcap", range(10))
    mcap_file(bag / "bag_1.mcap", range(10, 20))
    write_metadata(bag, ["bag_0.mcap", "bag_1.mcap"], {"/point": 20})
    return bag


# --- SQLite3: write-ahead logs and journals


def database(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    return connection


def add_tables(connection: sqlite3.Connection) -> None:
    connection.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
        " serialization_format TEXT);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
        " data BLOB);"
        f"INSERT INTO topics VALUES (1, '/point', '{POINT}', 'cdr');"
    )


def add_messages(connection: sqlite3.Connection, numbers: Sequence[int]) -> None:
    connection.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)",
        [(START_NS + number, point_cdr(number)) for number in numbers],
    )


def content_of(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in folder.iterdir()}


@pytest.mark.parametrize("in_database", [0, 10, 20])
@pytest.mark.parametrize("with_metadata", [False, True])
def test_a_write_ahead_log_is_read_and_left_as_it_is(
    tmp_path: Path, in_database: int, with_metadata: bool
) -> None:
    bag = tmp_path / "bag with a ? and a #"
    bag.mkdir()
    connection = database(tmp_path / "growing.db3")
    connection.execute("PRAGMA wal_autocheckpoint = 0")
    add_tables(connection)
    add_messages(connection, range(in_database))
    if in_database:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    add_messages(connection, range(in_database, 20))
    for suffix in ("", "-wal", "-shm"):  # as a recorder leaves them that is killed
        shutil.copy(tmp_path / f"growing.db3{suffix}", bag / f"bag_0.db3{suffix}")
    connection.close()
    if with_metadata:
        write_metadata(bag, ["bag_0.db3"], {"/point": 20})
    before = content_of(bag)
    bag.chmod(0o500)
    for path in (bag, bag / "bag_0.db3"):
        read = read_bag(path)
        assert numbers_of(read) == list(range(20))
        assert read.complete == with_metadata
    assert content_of(bag) == before


def bag_with_hot_journal(tmp_path: Path) -> Path:
    """A bag without metadata of 500 messages, amid a change of all of them."""
    bag = tmp_path / "bag"
    bag.mkdir()
    connection = sqlite3.connect(tmp_path / "growing.db3", isolation_level=None)
    add_tables(connection)
    add_messages(connection, range(500))
    connection.execute("PRAGMA cache_size = 1")
    connection.execute("PRAGMA cache_spill = 1")
    connection.execute("BEGIN")
    connection.execute("UPDATE messages SET data = x'00'")
    for suffix in ("", "-journal"):
        shutil.copy(tmp_path / f"growing.db3{suffix}", bag / f"bag_0.db3{suffix}")
    connection.close()
    return bag


def test_a_hot_journal_is_rolled_back_in_a_copy(tmp_path: Path) -> None:
    bag = bag_with_hot_journal(tmp_path)
    write_metadata(bag, ["bag_0.db3"], {"/point": 500})
    before = content_of(bag)
    read = read_bag(bag)
    assert read.complete
    assert numbers_of(read) == list(range(500))
    assert content_of(bag) == before


def test_a_journal_that_names_another_file_is_refused(tmp_path: Path) -> None:
    """SQLite would delete that file when it has rolled back."""
    bag, victim = bag_with_hot_journal(tmp_path), tmp_path / "victim.txt"
    victim.write_text("precious", encoding="utf-8")
    name = str(victim).encode()
    page = 0x40000000 // 4096 + 1
    with (bag / "bag_0.db3-journal").open("ab") as journal:
        journal.write(page.to_bytes(4, "big") + name + len(name).to_bytes(4, "big"))
        journal.write(sum(name).to_bytes(4, "big") + bytes.fromhex("d9d505f920a163d7"))
    with pytest.raises(BagNotReadable):
        read_bag(bag / "bag_0.db3")
    assert victim.exists()


def test_any_name_may_be_in_the_folder_of_a_bag(tmp_path: Path) -> None:
    connection = database(tmp_path / "bag_0.db3")
    add_tables(connection)
    connection.close()
    (tmp_path / "a1\N{SUPERSCRIPT TWO}3.db3").write_bytes(b"")
    assert not read_bag(tmp_path).complete


def test_a_log_without_end_is_not_copied(tmp_path: Path) -> None:
    connection = database(tmp_path / "bag_0.db3")
    add_tables(connection)
    connection.close()
    (tmp_path / "bag_0.db3-wal").touch()
    os.truncate(tmp_path / "bag_0.db3-wal", 10**15 // 100)
    with bounded(), pytest.raises(BagNotReadable):
        read_bag(tmp_path)
    (tmp_path / "bag_0.db3-wal").unlink()
    (tmp_path / "bag_0.db3-wal").symlink_to("/dev/zero")
    with bounded():
        assert read_bag(tmp_path).message_count == 0


@pytest.mark.parametrize(
    "messages",
    [
        "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
        " SELECT 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
        " data BLOB AS (zeroblob(900000000)));"
        "INSERT INTO messages(topic_id, timestamp) VALUES (1, 2)",
    ],
)
def test_a_database_that_makes_up_messages_is_bounded(tmp_path: Path, messages: str) -> None:
    connection = database(tmp_path / "bag_0.db3")
    add_tables(connection)
    connection.executescript(f"DROP TABLE messages; {messages}")
    connection.close()
    with bounded(600), suppress(BagNotReadable):
        assert not read_bag(tmp_path).complete


def test_rows_that_are_no_messages_are_counted(tmp_path: Path) -> None:
    connection = database(tmp_path / "bag_0.db3")
    add_tables(connection)
    add_messages(connection, range(3))
    connection.execute("INSERT INTO messages VALUES (9, 77, 1, x'00')")
    connection.execute("INSERT INTO messages VALUES (10, 1, 'noon', x'00')")
    connection.execute("INSERT INTO messages VALUES (11, 1, 1, NULL)")
    connection.close()
    write_metadata(tmp_path, ["bag_0.db3"], {"/point": 3})
    bag = read_bag(tmp_path)
    assert bag.message_count == 3
    assert not bag.complete


# --- Compressed files and messages


def test_compressed_files_whole_and_send_times_kept(two_files: Path) -> None:
    for name in ("bag_0.mcap", "bag_1.mcap"):
        pack(two_files / name)
    write_metadata(two_files, ["bag_0.mcap.zstd", "bag_1.mcap.zstd"], {"/point": 20})
    bag = read_bag(two_files)
    assert bag.complete
    assert bag.has_publish_times
    assert {r.log_time_ns - r.publish_time_ns for r in bag.records()} == {SENT}
    assert numbers_of(bag) == list(range(20))
    assert read_bag(two_files / "metadata.yaml").complete
    for number in range(2):
        assert read_bag(two_files / f"bag_{number}.mcap.zstd").message_count == 10


@pytest.mark.parametrize("size", [0, 3, 100, -1])
def test_a_cut_compressed_file_does_not_hide_the_others(two_files: Path, size: int) -> None:
    packed = pack(two_files / "bag_1.mcap")
    packed.write_bytes(packed.read_bytes()[:size])
    write_metadata(two_files, ["bag_0.mcap", "bag_1.mcap.zstd"], {"/point": 20})
    bag = read_bag(two_files)
    assert not bag.complete
    assert numbers_of(bag)[:10] == list(range(10))
    assert any("20" in fault for fault in bag.damage)


def test_a_cut_compressed_file_gives_what_is_before_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "random.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.NONE, chunk_size=1024 * 1024)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel("/noise", "cdr", 0)
        for time in range(40):
            writer.add_message(channel, time, b"\0\1\0\0" + os.urandom(30_000), time)
        writer.finish()
    packed = pack(path)
    packed.write_bytes(packed.read_bytes()[: packed.stat().st_size // 2])
    bag = read_bag(packed)
    assert 10 < bag.message_count < 40
    assert not bag.complete


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_compressed_files_without_metadata(two_files: Path, suffix: str) -> None:
    (two_files / "metadata.yaml").unlink()
    pack(two_files / "bag_0.mcap", suffix)
    bag = read_bag(two_files)
    assert numbers_of(bag) == list(range(20))
    assert not bag.complete


@pytest.mark.parametrize("keep", [False, True])
def test_files_unpacked_or_packed_by_hand_are_read_once(two_files: Path, keep: bool) -> None:
    write_metadata(two_files, ["bag_0.mcap.zstd", "bag_1.mcap"], {"/point": 20})
    pack(two_files / "bag_1.mcap")
    if keep:
        shutil.copy(two_files / "bag_0.mcap", two_files / "bag_0.mcap.zstd")
    bag = read_bag(two_files)
    assert bag.complete
    assert numbers_of(bag) == list(range(20))


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compression_is_seen_without_metadata(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
) -> None:
    recording = RobotRecording(count=4)
    path = rosbags_bag(tmp_path / "bag", recording, plugin, mode)
    file = next(file for file in path.iterdir() if file.name != "metadata.yaml")
    assert read_bag(file).message_count == len(recording.messages)
    (path / "metadata.yaml").unlink()
    for given in (path, file):
        bag = read_bag(given)
        assert bag.message_count == len(recording.messages)
        targets = [r.message.position.x for r in bag.records({"/target_pose"})]
        assert targets == [recording.target(number)[0] for number in range(4)]


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
def test_compressed_chunks(tmp_path: Path, compression: CompressionType) -> None:
    path = mcap_file(tmp_path / "one.mcap", range(50), compression=compression, chunk_size=200)
    bag = read_bag(path)
    assert bag.complete
    assert numbers_of(bag) == list(range(50))


# --- Counts and lists of files


@pytest.mark.parametrize(
    "counts",
    [{}, {"/point": 0}, {"/point": 10}, {"/point": 30}, {"/other": 20}, {"/point": 20, "/a": 1}],
)
def test_other_counts_than_those_of_the_metadata_are_told(
    two_files: Path, counts: Mapping[str, int]
) -> None:
    write_metadata(two_files, ["bag_0.mcap", "bag_1.mcap"], counts)
    bag = read_bag(two_files)
    assert bag.message_count == 20
    assert not bag.complete
    assert "20" in bag.damage[0]


@pytest.mark.parametrize("count", ["many", "[]", ".inf", "null"])
def test_a_count_that_is_none_is_not_called_complete(two_files: Path, count: str) -> None:
    (two_files / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 9\n"
        f"  relative_file_paths: [bag_0.mcap, bag_1.mcap]\n  message_count: {count}\n"
    )
    assert read_bag(two_files).message_count == 20
    assert not read_bag(two_files).complete


def test_a_file_that_is_not_listed_is_read_and_told(two_files: Path) -> None:
    write_metadata(two_files, ["bag_0.mcap"], {"/point": 10})
    bag = read_bag(two_files)
    assert bag.message_count == 20
    assert "bag_1.mcap" in bag.damage[0]
    assert not bag.complete


def test_a_file_that_is_listed_twice_or_with_its_folder_is_read_once(two_files: Path) -> None:
    names = ["bag/bag_0.mcap", "bag/bag_1.mcap", "bag_0.mcap"]
    write_metadata(two_files, names, {"/point": 20})
    bag = read_bag(two_files)
    assert bag.complete
    assert bag.message_count == 20


def test_a_missing_file_and_its_messages_are_told(two_files: Path) -> None:
    (two_files / "bag_0.mcap").unlink()
    bag = read_bag(two_files)
    assert "bag_0.mcap" in bag.damage[0]
    assert "/point 10 of 20" in bag.damage[1]


def test_one_of_several_files_is_compared_with_its_own_count(tmp_path: Path) -> None:
    recording = RobotRecording(count=3)
    path = rosbags_bag(tmp_path / "bag", recording, StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    metadata = path / "metadata.yaml"
    assert read_bag(file).complete
    metadata.write_text(metadata.read_text().replace(f": {len(recording.messages)}", ": 99"))
    assert not read_bag(file).complete
    metadata.unlink()
    assert not read_bag(file).complete


def test_a_file_that_lost_a_chunk_is_not_complete(tmp_path: Path) -> None:
    path = mcap_file(tmp_path / "one.mcap", range(50), chunk_size=200)
    content = path.read_bytes()
    start = content.index(b"\x06", 100)  # the first chunk that begins behind the header
    while True:
        start = content.index(b"\x06", start)
        (length,) = struct.unpack_from("<Q", content, start + 1)
        if 100 < length < 1000:
            break
        start += 1
    path.write_bytes(content[:start] + content[start + 9 + length :])
    bag = read_bag(path)
    assert 0 < bag.message_count < 50
    assert not bag.complete


def test_a_damaged_first_chunk_does_not_lose_the_channels(tmp_path: Path) -> None:
    path = mcap_file(tmp_path / "one.mcap", range(50), chunk_size=200)
    content = bytearray(path.read_bytes())
    content[content.index(point_cdr(0))] ^= 0xFF
    path.write_bytes(content)
    bag = read_bag(path)
    assert 40 < bag.message_count < 50
    assert not bag.complete


def test_a_pipe_in_the_folder_is_told_and_not_waited_for(two_files: Path) -> None:
    os.mkfifo(two_files / "bag_2.mcap")
    (two_files / "bag_3.db3").symlink_to("/dev/zero")
    with bounded():
        bag = read_bag(two_files)
    assert bag.message_count == 20
    assert not bag.complete
    (two_files / "metadata.yaml").unlink()
    os.mkfifo(two_files / "metadata.yaml")
    with bounded():
        assert read_bag(two_files).message_count == 20


def test_metadata_that_grows_is_damaged(two_files: Path) -> None:
    (two_files / "metadata.yaml").write_text(
        "a0: &a0 [x, x]\n"
        + "".join(
            f"a{level}: &a{level} [*a{level - 1}, *a{level - 1}]\n" for level in range(1, 60)
        )
    )
    with bounded():
        assert read_bag(two_files).message_count == 20


# --- Bombs


def with_chunk(path: Path, data: bytes, method: bytes, stated: int) -> Path:
    """A file of 50 messages with another chunk before those with messages."""
    mcap_file(path, range(50), chunk_size=200)
    content = path.read_bytes()
    (header_length,) = struct.unpack_from("<Q", content, 9)
    behind_header = 8 + 9 + header_length
    chunk = struct.pack("<QQQII", 0, 0, stated, 0, len(method)) + method
    chunk += struct.pack("<Q", len(data)) + data
    record = struct.pack("<BQ", 6, len(chunk)) + chunk
    # The summary moves.
    footer = len(content) - 8 - 20
    summary, offsets = struct.unpack_from("<QQ", content, footer)
    moved = struct.pack("<QQ", summary + len(record), offsets + len(record))
    content = content[:footer] + moved + content[footer + 16 :]
    path.write_bytes(content[:behind_header] + record + content[behind_header:])
    return path


@pytest.mark.parametrize("stated", [10, 200 * MEGABYTE, 300 * MEGABYTE, 2**63])
@pytest.mark.parametrize("method", ["zstd", "lz4"])
def test_a_chunk_that_unpacks_to_gigabytes_is_left_out(
    tmp_path: Path, method: str, stated: int
) -> None:
    import lz4.frame

    size = 300 * MEGABYTE
    if method == "zstd":
        packer = zstandard.ZstdCompressor().compressobj(size=size)
        data = b"".join(packer.compress(bytes(MEGABYTE)) for _ in range(300)) + packer.flush()
    else:
        packer = lz4.frame.LZ4FrameCompressor()
        data = packer.begin() + b"".join(packer.compress(bytes(MEGABYTE)) for _ in range(20))
        data += packer.flush()
    path = with_chunk(tmp_path / "bomb.mcap", data, method.encode(), stated)
    with bounded(100):
        bag = read_bag(path)
    assert numbers_of(bag) == list(range(50))
    assert not bag.complete


def test_a_frame_that_claims_gigabytes_is_left_out(tmp_path: Path) -> None:
    frame = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**40) + b"\x01\x00\x00"
    for stated in (100, 2**40):
        path = with_chunk(tmp_path / "claims.mcap", frame, b"zstd", stated)
        with bounded(100):
            assert read_bag(path).message_count == 50
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel("/claims", "cdr", 0)
        for data in (frame, zstandard.compress(bytes(100 * MEGABYTE)), b"\0\1\0\0"):
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    with bounded(300):
        bag = read_bag(path)
    assert bag.message_count == 1
    assert not bag.complete


def test_a_compressed_file_that_unpacks_to_gigabytes_is_cut(tmp_path: Path) -> None:
    whole = mcap_file(tmp_path / "bag_0.mcap", range(50), chunk_size=200).read_bytes()
    packer = zstandard.ZstdCompressor().compressobj()
    with (tmp_path / "bag_0.mcap.zstd").open("wb") as file:
        file.write(packer.compress(whole[:-60]))
        for _ in range(200):
            file.write(packer.compress(bytes(MEGABYTE)))
        file.write(packer.flush())
    with bounded(200):
        bag = read_bag(tmp_path / "bag_0.mcap.zstd")
    assert bag.message_count == 50
    assert not bag.complete


def test_a_record_longer_than_memory_ends_the_file(tmp_path: Path) -> None:
    path = mcap_file(tmp_path / "long.mcap", range(5))
    content = path.read_bytes()
    with path.open("r+b") as file:
        (header_length,) = struct.unpack_from("<Q", content, 9)
        file.seek(17 + header_length)
        file.write(struct.pack("<BQ", 5, 10**11))
        file.seek(10**11, os.SEEK_CUR)
        file.write(content[17 + header_length :])
    with bounded():
        assert not read_bag(path).complete

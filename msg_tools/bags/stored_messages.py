"""The messages of one file of a bag, MCAP or SQLite3, packed or not, up to where it is damaged."""

import os
import shutil
import sqlite3
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from io import BytesIO
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any, BinaryIO, Final, NamedTuple, cast

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdDecompressor, ZstdError

from annik_core.files import open_regular_file
from msg_tools.bags.errors import BagNotReadable
from msg_tools.bags.provisional_end import LIBRARY

#: Longest record, chunk or message, unpacked [bytes].
_LONGEST: Final = 256 * 1024 * 1024
#: What a file may unpack to: so many bytes, and so many for each of its own.
_LEAST_UNPACKED: Final = 64 * 1024 * 1024
#: The same of all chunks and messages together, which are unpacked one after the other.
_LEAST_IN_ALL: Final = 2 * 1024 * 1024 * 1024
_LARGEST_RATIO: Final = 200
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_SQLITE_MAGIC: Final = b"SQLite format 3\0"
#: At the end of a journal that names a file, which SQLite deletes when it has rolled back.
_NAMING_MAGIC: Final = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
#: What a message of a database takes besides its content, at least [bytes].
_ROW: Final = 64
_RECORD: Final = struct.Struct("<BQ")  #: how a record begins: kind and length
_MESSAGE: Final = struct.Struct("<HIQQ")  #: channel, number, times of receiving and sending
_END: Final = struct.Struct("<BxxxxxxxxQxxxxxxxxxxxx8s")  #: the footer, and what ends the file
#: What altered bytes raise, in the order of the layers that they reach.
_DAMAGE_ERRORS: Final = (
    *(McapError, ValueError, struct.error, RuntimeError, ZstdError, sqlite3.Error, MemoryError),
    *(OverflowError, ImportError),  # the latter where lz4, which is optional, is missing
)

_KINDS: Final[dict[int, Any]] = {
    Opcode.HEADER: records.Header,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.MESSAGE: records.Message,
    Opcode.CHUNK: records.Chunk,
    Opcode.STATISTICS: records.Statistics,
    Opcode.FOOTER: records.Footer,
}


class RawMessage(NamedTuple):
    """A message as stored."""

    topic: str
    type: str  #: such as ``geometry_msgs/msg/Pose``
    log_time_ns: int  #: when it was received [ns since the epoch]
    publish_time_ns: int  #: when it was sent [ns since the epoch]; the former where unknown
    data: bytes  #: CDR
    definition: str  #: text of the type; empty if the bag has none
    definition_format: str  #: ``ros2msg`` or ``ros2idl``


def stored_messages(path: Path, damage: list[str]) -> Iterator[RawMessage]:
    """Messages in the order of the file; appends one sentence per fault to ``damage``.

    What kind of file it is, and whether it or its messages are packed, is seen from its content.
    Nothing is written beside it.

    Raises:
        BagNotReadable: if the file can't be opened, or is neither MCAP nor SQLite3.
    """

    def tell(problem: str) -> None:
        damage.append(f"{path.name}: {problem}")

    damaged = 0
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open_regular_file(path))
            sizes = (log.stat().st_size for log in _logs(path))
            unpacker = _Unpacker(os.fstat(file.fileno()).st_size + sum(sizes))
            start = file.read(len(_SQLITE_MAGIC))
            if start.startswith(_ZSTD_MAGIC):
                packed, file = file, cast(BinaryIO, stack.enter_context(NamedTemporaryFile()))
                packed.seek(0)
                try:
                    file.writelines(_zstd_parts(packed, unpacker.most))
                except _DAMAGE_ERRORS as error:
                    tell(f"{error}; what follows is lost")
                file.seek(0)
                start = file.read(len(_SQLITE_MAGIC))
            if start.startswith(MCAP0_MAGIC):
                messages = _mcap_messages(file, unpacker, tell)
            elif start == _SQLITE_MAGIC:
                messages = _sqlite_messages(Path(file.name), unpacker, tell)
            else:
                raise ValueError("neither MCAP nor SQLite3, or cut in its first bytes")
            for message in messages:
                try:
                    yield unpacker.message(message)
                except _DAMAGE_ERRORS:
                    damaged += 1
        except (OSError, ValueError, sqlite3.Error) as error:
            raise BagNotReadable(path, getattr(error, "strerror", None) or str(error)) from error
    if damaged:
        tell(f"{damaged} compressed messages are damaged and left out")


class _Unpacker:
    """Unpacks what one file holds, up to a bound that follows from the size of the file."""

    def __init__(self, size: int) -> None:
        self.most = _LEAST_UNPACKED + _LARGEST_RATIO * size  #: at once
        self._left = _LEAST_IN_ALL + _LARGEST_RATIO * size
        self._rows_left = self.most

    def take(self, size: int) -> None:
        """Count what a database gives, whose tables may compute more than it holds."""
        self._rows_left -= size
        if self._rows_left < 0:
            raise ValueError("it holds more than is accepted of its size")

    def unpack(self, data: bytes, method: str, size: int) -> bytes:
        """The content of at most ``size`` bytes; raise a damage error if there is more."""
        if size > min(_LONGEST, self.most, self._left):
            raise ValueError(f"it would unpack to {size} bytes")
        if method == "zstd":
            content = b"".join(_zstd_parts(BytesIO(data), size))
        elif method == "lz4":
            import lz4.frame

            content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        else:
            raise ValueError(f"unknown compression {method[:20]!r}")
        self._left -= len(content)
        return content

    def message(self, message: RawMessage) -> RawMessage:
        """A message with its content unpacked; CDR, which begins with a zero, is not packed."""
        if not message.data.startswith(_ZSTD_MAGIC):
            return message
        most = min(_LONGEST, self.most, self._left)
        return message._replace(data=self.unpack(message.data, "zstd", most))


def _zstd_parts(packed: BinaryIO, most: int) -> Iterator[bytes]:
    frame = ZstdDecompressor().decompressobj()
    # A part has at most 32 MiB: zstd makes up to 32 KiB of one byte.
    while block := frame.unused_data or packed.read(1024):
        if frame.eof:
            frame = ZstdDecompressor().decompressobj()
        part = frame.decompress(block)
        most -= len(part)
        if most < 0:
            raise ValueError("it unpacks to more than it states, or than is accepted of its size")
        yield part
    if not frame.eof:
        raise ValueError("its compressed content is cut")


def _mcap_messages(
    file: BinaryIO, unpacker: _Unpacker, tell: Callable[[str], None]
) -> Iterator[RawMessage]:
    channels: dict[int, records.Channel] = {}
    schemas = {0: ("", "", "")}  # 0 means none
    counted: int | None = None
    read = 0
    try:
        for record in _all_records(file, unpacker, tell):
            if isinstance(record, records.Message):
                if record.channel_id not in channels:
                    raise ValueError(f"a message has the unknown channel {record.channel_id}")
                channel = channels[record.channel_id]
                kind, *definition = schemas.get(channel.schema_id, schemas[0])
                read += 1
                yield RawMessage(
                    channel.topic,
                    kind,
                    record.log_time,
                    record.publish_time or record.log_time,
                    record.data,
                    *definition,
                )
            elif isinstance(record, records.Schema):
                text = record.data.decode(errors="replace")
                schemas[record.id] = record.name, text, record.encoding
            elif isinstance(record, records.Channel):
                channels[record.id] = record
            elif isinstance(record, records.Statistics):
                counted = record.message_count
    except _DAMAGE_ERRORS as error:
        tell(f"a record is damaged ({error}); what follows it is lost")
    if counted not in (None, read):
        tell(f"{read} messages could be read; the file itself counts {counted}")


def _all_records(
    file: BinaryIO, unpacker: _Unpacker, tell: Callable[[str], None]
) -> Iterator[records.McapRecord]:
    """Records of a file and of its chunks; first those of the summary, which repeats channels."""
    size = os.fstat(file.fileno()).st_size
    with suppress(*_DAMAGE_ERRORS):
        file.seek(max(0, size - _END.size))
        opcode, summary_start, magic = _END.unpack(file.read())
        if opcode == Opcode.FOOTER and magic == MCAP0_MAGIC and summary_start:
            file.seek(summary_start)
            for record in _records(file, size):
                if isinstance(record, records.Schema | records.Channel):
                    yield record
    file.seek(len(MCAP0_MAGIC))
    library = ""
    try:
        for record in _records(file, size):
            if isinstance(record, records.Header):
                library = record.library
            elif isinstance(record, records.Footer):
                if not record.summary_start and library == LIBRARY:
                    tell(
                        "the recorder was killed; what it received in its last moment is not in "
                        "the file"
                    )
                if file.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                    return
            elif isinstance(record, records.Chunk):
                try:
                    yield from _records_of(record, unpacker)
                except _DAMAGE_ERRORS as error:
                    tell(f"a chunk is damaged ({error}): messages are left out")
            else:
                yield record
    except (EndOfFile, struct.error):
        pass
    tell("the file has no proper end; it was cut, or its writer was killed")


def _records(file: BinaryIO, size: int) -> Iterator[records.McapRecord]:
    """Records from here on, of the kinds that matter.

    Raises:
        EndOfFile: behind a chunk, or instead of another record, that the end of the file cuts.
        ValueError: if a record is longer than any of a bag.
    """
    while (start := file.tell()) < size:
        opcode, length = _RECORD.unpack(file.read(_RECORD.size))
        end = start + _RECORD.size + length
        if end > size and opcode != Opcode.CHUNK:
            raise EndOfFile("it is cut")
        if opcode in _KINDS:
            if min(length, size) > _LONGEST:
                raise ValueError(f"it has {length} bytes")
            content = file.read(min(length, size))
            if opcode == Opcode.MESSAGE:  # most records are one
                channel, number, received, sent = _MESSAGE.unpack_from(content)
                yield records.Message(channel, received, content[_MESSAGE.size :], sent, number)
            else:
                yield _KINDS[opcode].read(ReadDataStream(BytesIO(content)))
        if end > size or not opcode:
            raise EndOfFile("it is cut")
        file.seek(end)


def _records_of(chunk: records.Chunk, unpacker: _Unpacker) -> Iterator[records.McapRecord]:
    """The records of a chunk; of one that is cut and not compressed, those before the cut."""
    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression:
        data = unpacker.unpack(data, chunk.compression, size)
    if len(data) == size and chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("its checksum is wrong")
    yield from _records(BytesIO(data), len(data))
    if len(data) != size:
        raise ValueError("it is cut")


def _sqlite_messages(
    path: Path, unpacker: _Unpacker, tell: Callable[[str], None]
) -> Iterator[RawMessage]:
    unusable = 0
    with ExitStack() as stack:
        database = stack.enter_context(closing(_database(path, stack)))
        # A view could make up messages without end.
        kind = "type = 'table' AND sql LIKE 'CREATE TABLE%'"
        tables = {
            row[0] for row in database.execute(f"SELECT name FROM sqlite_master WHERE {kind}")
        }
        if not {"topics", "messages"} <= tables:
            raise ValueError("a database without the tables of a bag")
        definitions = {}
        if "message_definitions" in tables:
            columns = "topic_type, encoded_message_definition, encoding"
            rows = database.execute(f"SELECT {columns} FROM message_definitions")
            for kind, text, encoding in rows:
                unpacker.take(_ROW + len(text or ""))
                definitions[kind] = text, encoding
        try:
            # In the order of their rows: an order by time needs an index that may be damaged.
            for topic, kind, time, data in database.execute(
                "SELECT topics.name, topics.type, messages.timestamp, messages.data "
                "FROM messages LEFT JOIN topics ON topics.id = messages.topic_id"
            ):
                if [type(value) for value in (topic, kind, time, data)] == [str, str, int, bytes]:
                    unpacker.take(_ROW + len(topic) + len(kind) + len(data))
                    definition = definitions.get(kind, ("", ""))
                    yield RawMessage(topic, kind, time, time, data, *definition)
                else:
                    unusable += 1
        except _DAMAGE_ERRORS as error:
            tell(f"the database is damaged ({error}); what follows is lost")
    if unusable:
        tell(f"{unusable} messages have no topic, no time or no content")


def _logs(path: Path) -> list[Path]:
    return [log for end in ("-wal", "-journal") if (log := Path(f"{path}{end}")).exists()]


def _database(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """Open a database; in a copy if it has a log, which SQLite would write into it."""
    logs = _logs(path)
    address = f"{path.absolute().as_uri()}?immutable=1"
    if any(log.stat().st_size for log in logs):
        folder = Path(stack.enter_context(TemporaryDirectory()))
        needed = sum(file.stat().st_size for file in (path, *logs))
        if needed > shutil.disk_usage(folder).free // 2:
            raise ValueError(f"it has a log, and a copy needs {needed} bytes in {folder}")
        for file in (path, *logs):
            with open_regular_file(file) as source, (folder / file.name).open("w+b") as copy:
                shutil.copyfileobj(source, copy)
                copy.seek(max(0, copy.tell() - len(_NAMING_MAGIC)))
                if copy.read() == _NAMING_MAGIC:
                    raise ValueError("its journal belongs to several databases")
        address = (folder / path.name).as_uri()
    database = sqlite3.connect(address, uri=True)
    if sys.version_info >= (3, 11):
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST)
    return database

"""The messages of one MCAP file, up to where it is damaged.

The parts of a record are read by the ``mcap`` library. The walk from record to record is here,
because a file that was cut must give every message before the cut, also those inside the chunk
that the cut went through.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, Message, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from msg_tools.bags.errors import BagNotReadable
from msg_tools.bags.writer import LIBRARY

_RECORD_HEAD: Final = struct.Struct("<BQ")
_CHUNK_HEAD: Final = struct.Struct("<QQQI")
_MESSAGE_HEAD_SIZE: Final = 22
_DAMAGE_ERRORS: Final = (
    McapError,
    ValueError,
    struct.error,
    RuntimeError,
    ZstdError,
    MemoryError,
    OverflowError,
)


class McapMessage(NamedTuple):
    """A message as stored.

    Attributes:
        channel: topic, encoding and schema number.
        log_time_ns: when it was received [ns since the epoch].
        publish_time_ns: when it was sent [ns since the epoch].
        data: CDR.
    """

    channel: Channel
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class _Record(NamedTuple):
    opcode: int
    content: bytes
    whole: bool


@dataclass
class McapMessages:
    """One reading of a file; iterate over it once.

    Attributes:
        path: the MCAP file.
        channels: by number, as met so far.
        schemas: by number, as met so far.
        damage: what was lost, empty when nothing; known once the iteration has ended.
    """

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    damage: str = ""
    _library: str = ""
    _closed: bool = False

    def __iter__(self) -> Iterator[McapMessage]:
        """Messages in the order of the file.

        Raises:
            BagNotReadable: if the file can't be opened or does not begin as an MCAP file does.
        """
        try:
            with self.path.open("rb") as file:
                if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                    raise BagNotReadable(self.path, "not an MCAP file, or cut in its first bytes")
                yield from self._messages(file)
        except OSError as error:
            raise BagNotReadable(self.path, error.strerror or str(error)) from error
        if not self._closed and not self.damage:
            self.damage = "the file has no proper end: it was cut, or its writer was killed"

    def _messages(self, file: BinaryIO) -> Iterator[McapMessage]:
        for record in _records(file):
            try:
                if record.opcode == Opcode.CHUNK:
                    yield from self._chunk_messages(record)
                elif not record.whole:
                    self.damage = "the file is cut inside a record"
                elif record.opcode == Opcode.HEADER:
                    self._library = Header.read(_stream(record.content)).library
                elif record.opcode == Opcode.FOOTER:
                    self._end(Footer.read(_stream(record.content)), file.read(len(MCAP0_MAGIC)))
                    return
                else:
                    message = self._understand(record)
                    if message is not None:
                        yield message
            except _DAMAGE_ERRORS as error:
                self.damage = f"a record is damaged ({error}); what follows it is lost"
                return

    def _end(self, footer: Footer, magic: bytes) -> None:
        self._closed = magic == MCAP0_MAGIC
        if footer.summary_start == 0 and self._library == LIBRARY:
            self.damage = (
                "the recorder was killed: what it received in its last moment is not in the file"
            )

    def _chunk_messages(self, record: _Record) -> Iterator[McapMessage]:
        if not record.whole:
            self.damage = "the file is cut inside a chunk; the messages before the cut are read"
            data = _readable_part_of_chunk(record.content)
        else:
            chunk = Chunk.read(_stream(record.content))
            try:
                stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            except CRCValidationError:
                self.damage = "a chunk fails its checksum; its messages are left out"
                return
            data = stream.read(size)
        for inner in _records(BytesIO(data)):
            if not inner.whole:
                self.damage = self.damage or "a chunk ends inside a record"
                return
            message = self._understand(inner)
            if message is not None:
                yield message

    def _understand(self, record: _Record) -> McapMessage | None:
        stream = _stream(record.content)
        if record.opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif record.opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels[channel.id] = channel
        elif record.opcode == Opcode.MESSAGE:
            if len(record.content) < _MESSAGE_HEAD_SIZE:
                raise ValueError("a message is shorter than its head")
            message = Message.read(stream, len(record.content))
            if message.channel_id not in self.channels:
                raise ValueError(f"a message is on the unknown channel {message.channel_id}")
            return McapMessage(
                self.channels[message.channel_id],
                message.log_time,
                message.publish_time,
                message.data,
            )
        return None


def _records(file: BinaryIO) -> Iterator[_Record]:
    """Records of a file from where it stands; the last one may be cut."""
    while head := file.read(_RECORD_HEAD.size):
        if len(head) < _RECORD_HEAD.size:
            yield _Record(0, b"", whole=False)
            return
        opcode, length = _RECORD_HEAD.unpack(head)
        # A damaged length must not make Python ask for that much memory.
        content = file.read(min(length, 2**31))
        yield _Record(opcode, content, whole=len(content) == length)


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _readable_part_of_chunk(content: bytes) -> bytes:
    """The records of a cut chunk, as far as they are there; empty if they were compressed."""
    stream = BytesIO(content)
    stream.seek(_CHUNK_HEAD.size)
    lengths = stream.read(4)
    if lengths != b"\0\0\0\0" or len(stream.read(8)) < 8:
        return b""
    return stream.read()

"""The messages of one MCAP file, up to where it is damaged."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from msg_tools.bags.errors import BagNotReadable
from msg_tools.bags.provisional_end import LIBRARY

#: What a file that ends too early raises; the limit of a record's length is that of the file.
_CUT_ERRORS: Final = (EndOfFile, RecordLengthLimitExceeded, struct.error)
#: What altered bytes raise, in the order of the layers that they reach.
_DAMAGE_ERRORS: Final = (
    McapError,
    ValueError,
    struct.error,
    RuntimeError,
    ZstdError,
    MemoryError,
    OverflowError,
)


class RawMessage(NamedTuple):
    """A message as stored."""

    topic: str
    type: str  #: such as ``geometry_msgs/msg/Pose``
    log_time_ns: int  #: when it was received [ns since the epoch]
    publish_time_ns: int  #: when it was sent [ns since the epoch]
    data: bytes  #: CDR
    definition: str  #: text of the type; empty if the bag has none
    definition_format: str  #: ``ros2msg`` or ``ros2idl``


def mcap_messages(path: Path, damage: list[str]) -> Iterator[RawMessage]:
    """Messages in the order of the file; appends one sentence per fault to ``damage``.

    Raises:
        BagNotReadable: if the file can't be opened or does not begin as an MCAP file does.
    """
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    try:
        with path.open("rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise BagNotReadable(path, "not an MCAP file, or cut in its first bytes")
            for record in _records(file, damage):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    if record.channel_id not in channels:
                        raise ValueError(f"a message has the unknown channel {record.channel_id}")
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    yield RawMessage(
                        channel.topic,
                        schema.name if schema else "",
                        record.log_time,
                        record.publish_time,
                        record.data,
                        schema.data.decode(errors="replace") if schema else "",
                        schema.encoding if schema else "",
                    )
    except OSError as error:
        raise BagNotReadable(path, error.strerror or str(error)) from error
    except _DAMAGE_ERRORS as error:
        damage.append(f"{path.name}: a record is damaged ({error}); what follows it is lost")


def _records(file: BinaryIO, damage: list[str]) -> Iterator[McapRecord]:
    """Records behind the magic bytes; those of the chunk that the end of the file cuts, too."""
    name = Path(file.name).name
    size = os.fstat(file.fileno()).st_size
    file.seek(0)
    start = len(MCAP0_MAGIC)
    library = ""
    try:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=size).records:
            start = file.tell()
            if isinstance(record, Header):
                library = record.library
            elif isinstance(record, Footer) and not record.summary_start and library == LIBRARY:
                damage.append(
                    f"{name}: the recorder was killed; what it received in its last moment is "
                    "not in the file"
                )
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                yield from breakup_chunk(record, validate_crc=True)
            except _DAMAGE_ERRORS as error:
                damage.append(
                    f"{name}: a chunk fails its checksum or can't be unpacked ({error}); its "
                    "messages are left out"
                )
    except _CUT_ERRORS:
        damage.append(f"{name}: the file has no proper end; it was cut, or its writer was killed")
        yield from _records_of_cut_chunk(file, start)


def _records_of_cut_chunk(file: BinaryIO, start: int) -> Iterator[McapRecord]:
    """The complete records of a chunk at ``start``; none if it is compressed or no chunk."""
    file.seek(start)
    stream = ReadDataStream(file)
    try:
        if stream.read1() == Opcode.CHUNK:
            stream.read8()
            chunk = Chunk.read(stream)
            if not chunk.compression:
                yield from StreamReader(BytesIO(chunk.data), skip_magic=True).records
    except _DAMAGE_ERRORS:
        return

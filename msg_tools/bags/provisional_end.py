"""A growing MCAP file with a valid end at every moment.

Readers of ROS 2 bags refuse an MCAP file without a footer, as a killed writer leaves it. So each
flush writes the new records *and* the shortest valid end of file (50 bytes) in one system call;
the next flush overwrites that end.
"""

import os
from pathlib import Path
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC

#: Library name in the header, by which a reader recognises a bag of annik that was never closed.
LIBRARY: Final = "annik"


def _shortest_end() -> bytes:
    builder = RecordBuilder()
    DataEnd(data_section_crc=0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    records: bytes = builder.end()  # type: ignore[no-untyped-call]
    return records + MCAP0_MAGIC


SHORTEST_END: Final = _shortest_end()


class ClosedMcapFile:
    """Output stream for an ``mcap.writer.Writer``; bytes reach the file at each flush.

    Errors are those of the system: OSError.
    """

    def __init__(self, path: Path) -> None:
        """Create the file, which must not exist."""
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        self._pending: list[bytes] = []
        self._pending_size = 0
        self._written = 0

    def write(self, data: bytes) -> int:
        """Keep bytes for the next flush; return their count."""
        self._pending.append(bytes(data))
        self._pending_size += len(data)
        return len(data)

    def tell(self) -> int:
        """Offset in the file of the next byte."""
        return self._written + self._pending_size

    def flush(self) -> None:
        """Write the pending bytes and an end of file; if that fails, all earlier flushes stay."""
        if self._pending:
            self._write_pending(SHORTEST_END)

    def close(self, *, with_own_end: bool) -> None:
        """Write the pending bytes and close the file; a second call does nothing.

        An end of file is added unless the pending bytes have their own. The file is closed even if
        writing fails.
        """
        if self._descriptor < 0:
            return
        try:
            if self._pending:
                self._write_pending(b"" if with_own_end else SHORTEST_END)
        finally:
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)

    def _write_pending(self, end: bytes) -> None:
        data = b"".join(self._pending)
        self._pending.clear()
        self._pending_size = 0
        try:
            self._write_at(data + end, self._written)
        except OSError:
            self._roll_back()
            raise
        self._written += len(data)

    def _roll_back(self) -> None:
        # Blocks that the file already has can be overwritten on a full disk too.
        if self._written:
            self._write_at(SHORTEST_END, self._written)
            os.ftruncate(self._descriptor, self._written + len(SHORTEST_END))

    def _write_at(self, data: bytes, offset: int) -> None:
        view = memoryview(data)
        while view:
            count = os.pwrite(self._descriptor, view, offset)
            view = view[count:]
            offset += count

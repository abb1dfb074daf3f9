"""Append-only log of JSON records, one a line; every append is synced to the disk.

A record is a mapping with the key ``check``, the checksum of the rest. A last line that a killed
process left incomplete is removed when the log is opened; an altered line is refused.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from annik_core.errors import DamagedRecord, InUse, NotWritable
from annik_core.files import open_regular_file

_CHECK = "check"
_MOST_BYTES = 256 * 1024 * 1024


class AppendLog:
    """A log, locked for this process alone; a context manager, or to be closed.

    ``truncated``: an incomplete last line was removed when the log was opened.
    """

    def __init__(self, path: Path, *, has_header: bool = False) -> None:
        """Open a log; create it and its folder if they are missing.

        If ``has_header``, the first record says what the others belong to.

        Raises:
            InUse: if another process has it open.
            DamagedRecord: if a line was altered.
            NotWritable: if the file can't be opened.
        """
        self.path = path
        self._has_header = has_header
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():  # a pipe, or a device without end
                open_regular_file(path).close()
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise self._not_writable(error) from error
        try:
            self._lock()
            self._records, self._size = self._read()
            self.truncated = self._truncate()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> "AppendLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close and unlock the file."""
        self._file.close()

    @property
    def records(self) -> tuple[dict[str, Any], ...]:
        """The records of the file, first to last, without their checksums."""
        return tuple(self._records)

    def append(self, record: Mapping[str, Any]) -> None:
        """Append a record of JSON values without a key ``check``; it is on the disk at the return.

        Raises:
            NotWritable: if it can't be written. The file is then as it was before.
        """
        text = json.dumps({**record, _CHECK: digest(record)}, allow_nan=False)
        self._append(text.encode() + b"\n")
        self._records.append(dict(record))

    def reload(self) -> None:
        """Read the records from the file again; raise DamagedRecord if a line was altered."""
        self._records, self._size = self._read()

    def damaged(self, line: int, problem: str) -> DamagedRecord:
        """The error for the record in a line, from 1, that does not mean what it should."""
        if self._has_header and line == 1:
            remedy = "the file can't be used without its first line: give another file"
        else:
            remedy = "delete this line (what it records is then done again), or give another file"
        return DamagedRecord(self.path, line, problem, remedy)

    def _not_writable(self, error: OSError) -> NotWritable:
        return NotWritable(
            self.path,
            error.strerror or str(error),
            "check the folder and free space; what was written before is kept, and the same "
            "command continues from there",
        )

    def _lock(self) -> None:
        # The lock on the file is released when the process ends, however it ends.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InUse(self.path) from error
        except OSError as error:
            raise self._not_writable(error) from error

    def _read(self) -> tuple[list[dict[str, Any]], int]:
        """The records, and the size of the file up to the last complete line."""
        self._file.seek(0)
        size = os.fstat(self._file.fileno()).st_size
        if size > _MOST_BYTES:
            reason = f"{size} bytes; at most {_MOST_BYTES} are read"
            raise NotWritable(self.path, reason, "give another file")
        data = self._file.read()
        complete = data[: data.rfind(b"\n") + 1]
        lines = complete.split(b"\n")[:-1]
        return [self._record(number, line) for number, line in enumerate(lines, 1)], len(complete)

    def _record(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            record = json.loads(line)
            check = record.pop(_CHECK)
            if check == digest(record):
                return dict(record)
        # ValueError: not JSON or not UTF-8. The others: JSON of another structure.
        except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
            pass
        raise self.damaged(number, "it is damaged, or was not written by annik")

    def _truncate(self) -> bool:
        try:
            if os.fstat(self._file.fileno()).st_size == self._size:
                return False
            os.ftruncate(self._file.fileno(), self._size)
        except OSError as error:
            raise self._not_writable(error) from error
        return True

    def _append(self, data: bytes) -> None:
        descriptor = self._file.fileno()
        try:
            written = 0
            while written < len(data):
                # A disk that becomes full first accepts a part.
                written += os.write(descriptor, data[written:])
            os.fsync(descriptor)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(descriptor, self._size)
            raise self._not_writable(error) from error
        self._size += len(data)


def digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of JSON values, independent of the order of keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()

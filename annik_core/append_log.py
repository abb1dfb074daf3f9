"""A file of lines that are only appended, each safe as soon as it is written.

A line is a mapping as JSON, with ``check``, a checksum of the rest. What a process that was killed
left of a line is taken off when the file is opened again; a line that was altered is refused.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from annik_core.errors import AnnikError


class CheckedLinesError(AnnikError):
    """A file of checked lines can't be used.

    Who owns the file gives its own error in place of this one, with a remedy.
    """


class CheckedLinesInUse(CheckedLinesError):
    """Another process has the file open."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(f"{path} is in use by another process")


class DamagedLine(CheckedLinesError):
    """A line is not as it was written."""

    def __init__(self, path: Path, line: int, problem: str) -> None:
        self.path = path
        self.line = line
        self.problem = problem
        super().__init__(f"{path}, line {line}: {problem}")


class CheckedLinesNotWritable(CheckedLinesError):
    """The file can't be opened or extended."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path} can't be written ({reason})")


_CHECK = "check"


class CheckedLines:
    """The lines of a file, open for this process alone.

    Use it as a context manager, or close it.

    Attributes:
        path: the file.
        was_cut_off: whether the last line was incomplete, and was taken off.
    """

    def __init__(self, path: Path) -> None:
        """Open a file; it, and its folder, are made if they are not there.

        Raises:
            CheckedLinesInUse: if another process has it open.
            DamagedLine: if a line is not as it was written.
            CheckedLinesNotWritable: if the file can't be opened.
        """
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise CheckedLinesNotWritable(path, error.strerror or str(error)) from error
        try:
            self._lock()
            self._lines, self._size = self._read()
            self.was_cut_off = self._cut_off()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> CheckedLines:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file, which unlocks it."""
        self.close()

    def close(self) -> None:
        """Close the file, which unlocks it."""
        self._file.close()

    @property
    def lines(self) -> tuple[dict[str, Any], ...]:
        """The lines that are in the file, first to last, without their checksums."""
        return tuple(self._lines)

    def append(self, line: Mapping[str, Any]) -> None:
        """Append a line; it is on the disk when this returns.

        Args:
            line: what JSON can hold; without a key ``check``.

        Raises:
            CheckedLinesNotWritable: if it can't be written. The file is then as it was before.
        """
        text = json.dumps({**line, _CHECK: digest(line)}, allow_nan=False)
        self._append(text.encode() + b"\n")
        self._lines.append(dict(line))

    def read_again(self) -> None:
        """Take the lines from the file, as if it were opened now."""
        self._lines, self._size = self._read()

    def _lock(self) -> None:
        # On the file itself: the lock goes when the process ends, however it ends.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise CheckedLinesInUse(self.path) from error
        except OSError as error:
            raise CheckedLinesNotWritable(self.path, error.strerror or str(error)) from error

    def _read(self) -> tuple[list[dict[str, Any]], int]:
        """The lines, and where the last whole one ends."""
        self._file.seek(0)
        data = self._file.read()
        # What follows the last end of line was being written when the process or machine died.
        whole = data[: data.rfind(b"\n") + 1]
        texts = whole.split(b"\n")[:-1]
        return [self._line(number, text) for number, text in enumerate(texts, start=1)], len(whole)

    def _line(self, number: int, text: bytes) -> dict[str, Any]:
        try:
            line = json.loads(text)
            check = line.pop(_CHECK)
            if check == digest(line):
                return dict(line)
        # JSON's and Unicode's faults are ValueErrors; the others are another form.
        except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
            pass
        raise DamagedLine(self.path, number, "it is damaged, or not of annik")

    def _cut_off(self) -> bool:
        try:
            if os.fstat(self._file.fileno()).st_size == self._size:
                return False
            os.ftruncate(self._file.fileno(), self._size)
        except OSError as error:
            raise CheckedLinesNotWritable(self.path, error.strerror or str(error)) from error
        return True

    def _append(self, data: bytes) -> None:
        descriptor = self._file.fileno()
        try:
            written = 0
            while written < len(data):
                # A disk that fills up takes a part first.
                written += os.write(descriptor, data[written:])
            os.fsync(descriptor)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(descriptor, self._size)
            raise CheckedLinesNotWritable(self.path, error.strerror or str(error)) from error
        self._size += len(data)


def digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain data, whatever the order of its keys."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()

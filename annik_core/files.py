"""Reading of regular files only; atomic replacement: the old file or the whole new one."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from annik_core.errors import NotWritable


def expanded(path: str | Path) -> Path:
    """A path with the folder of the user for a leading ``~``."""
    try:
        return Path(path).expanduser()
    except RuntimeError:  # a user that this system does not know
        return Path(path)


def read_regular_file(path: Path, most: int) -> bytes:
    """The content of a file, after following links; never waits for it.

    Raises:
        OSError: if it can't be read, is a folder, a pipe or a device, or has over ``most`` bytes.
        ValueError: if no file could have this path.
    """
    # Opening a pipe would wait for one that writes to it.
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is a pipe or a device, not a regular file")
        content = b"" if status.st_size > most else file.read(most + 1)
    size = max(status.st_size, len(content))
    if size > most:
        raise OSError(errno.EFBIG, f"{size} bytes; at most {most} are accepted")
    return content


def ensure_writable_folder(folder: Path) -> None:
    """Create a folder if it is missing; raise NotWritable if no files can be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise NotWritable(folder, error.strerror or str(error)) from error


def write_files_atomically(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write files, by name, into an existing folder; replace none before all are complete.

    Raises:
        NotWritable: if one can't be written; existing files are then unchanged, unless the
            renaming itself fails half-way. Names the file if it is the only one.
    """
    temporary = {name: folder / f".{name}.{os.getpid()}.tmp" for name in contents}
    try:
        for name, content in contents.items():
            temporary[name].write_bytes(content)
        for name in contents:
            temporary[name].replace(folder / name)
    except OSError as error:
        path = folder / next(iter(contents)) if len(contents) == 1 else folder
        raise NotWritable(path, error.strerror or str(error)) from error
    finally:
        for path in temporary.values():
            with suppress(OSError):
                path.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file, and its folder if it does not exist; raise NotWritable, naming the path."""
    ensure_writable_folder(path.parent)
    write_files_atomically(
        path.parent, {path.name: content.encode() if isinstance(content, str) else content}
    )

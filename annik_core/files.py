"""Atomic replacement of files: what stands there is the old file or the whole new one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from annik_core.errors import NotWritable


def ensure_writable_folder(folder: Path) -> None:
    """Create a folder if it is missing, and check that files can be written there.

    Raises:
        NotWritable: if not.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise NotWritable(folder, error.strerror or str(error)) from error


def write_files_atomically(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write several files of one folder, replacing none before all are complete beside them.

    Args:
        folder: existing folder.
        contents: file name to bytes.

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

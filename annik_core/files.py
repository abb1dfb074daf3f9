"""Files that are either the old one or the whole new one, never a part."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path


def ensure_writable_folder(folder: Path) -> None:
    """Make a folder, and find out before long work whether files can be written there.

    Raises:
        OSError: if not.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def write_files_atomically(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write several files of one folder, replacing none before all are safely beside them.

    Args:
        folder: existing folder.
        contents: file name to bytes.

    Raises:
        OSError: if one can't be written; the files that were there before are then untouched,
            unless the very renaming fails half-way.
    """
    temporary = {name: folder / f".{name}.{os.getpid()}.tmp" for name in contents}
    try:
        for name, content in contents.items():
            temporary[name].write_bytes(content)
        for name in contents:
            temporary[name].replace(folder / name)
    finally:
        for path in temporary.values():
            with suppress(OSError):
                path.unlink(missing_ok=True)

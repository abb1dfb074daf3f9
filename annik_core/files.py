"""Reading of regular files only, and of YAML of a bounded size; atomic replacement of files."""

import errno
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Final

import yaml

from annik_core.errors import NotWritable


def expanded(path: str | Path) -> Path:
    """A path with the folder of the user for a leading ``~``."""
    try:
        return Path(path).expanduser()
    except RuntimeError:  # a user that this system does not know
        return Path(path)


def open_regular_file(path: Path) -> BinaryIO:
    """Open a file for reading, after following links; never waits for it.

    Raises:
        OSError: if it can't be opened, or is a folder, a pipe or a device.
        ValueError: if no file could have this path.
    """
    # Otherwise opening a pipe waits for a process that writes to it.
    file = open(  # noqa: SIM115
        path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
    )
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a regular file")
    return file


def read_regular_file(path: Path, most: int) -> bytes:
    """The content of a file, opened by :func:`open_regular_file`.

    Raises:
        OSError: if it can't be read or opened, or has over ``most`` bytes.
        ValueError: if no file could have this path.
    """
    with open_regular_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        content = b"" if size > most else file.read(size + 1)
        # A file of the kernel has a content, but no size.
        while content and len(content) <= most and (more := file.read(64 * 1024)):
            content += more
    size = max(size, len(content))
    if size > most:
        raise OSError(errno.EFBIG, f"{size} bytes; at most {most} are accepted")
    return content


def read_text(path: str | Path, most: int = 4 * 1024 * 1024) -> str:
    """The UTF-8 text of a regular file of at most so many bytes; ``~`` is the user's folder.

    Raises:
        OSError: see :func:`read_regular_file`.
        ValueError: if it is not UTF-8, or if no file could have this path.
    """
    return read_regular_file(expanded(path), most).decode("utf-8-sig")


class _BoundedLoader(yaml.SafeLoader):
    """YAML of bounded depth and size, in which an alias counts as much as what it stands for."""

    most_values: Final = 100_000
    most_levels: Final = 64
    most_digits: Final = 1000  #: of an integer: reading one takes a time quadratic in its length

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.values = self.levels = 0
        self.anchored: dict[str, int] = {}  # anchor: number of its values

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        before = self.values
        alias = isinstance(event, yaml.AliasEvent)
        # An alias inside what it stands for has no end, and no count yet.
        self.values += self.anchored.get(event.anchor, self.most_values) if alias else 1
        self.levels += 1
        if self.values > self.most_values or self.levels > self.most_levels:
            most = f"{self.most_values} values, aliases expanded, or {self.most_levels} levels"
            raise ValueError(f"more than {most}")
        node: yaml.Node | None = super().compose_node(parent, index)
        self.levels -= 1
        if event.anchor is not None and not alias:
            self.anchored[event.anchor] = self.values - before
        if node is not None and node.tag.endswith(":int") and len(node.value) > self.most_digits:
            raise ValueError(f"an integer has more than {self.most_digits} digits")
        return node


def bounded_yaml(text: str) -> Any:
    """Plain data from YAML, in bounded time and memory.

    Raises:
        ValueError: if it is not YAML, is nested too deeply, or has too many values.
    """
    try:
        return yaml.load(text, _BoundedLoader)
    # Besides YAMLError, PyYAML lets through whatever an ill-formed date or tag runs into.
    except Exception as error:
        raise ValueError(str(error)) from error


def ensure_writable_folder(folder: Path) -> None:
    """Create a folder if it is missing; raise NotWritable if no files can be written there."""
    # Not above: it loads slowly.
    from tempfile import TemporaryFile

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
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

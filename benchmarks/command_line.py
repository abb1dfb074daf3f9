"""What the command lines of the benchmarks share: their files, common options, one-line faults."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from annik_core.errors import AnnikError, one_line
from annik_core.files import ensure_writable_folder, write_file, write_files_atomically

ROOT = Path(__file__).parents[1]
#: Where a benchmark writes, a folder for each.
BUILD = ROOT / "build"
DOCS = ROOT / "docs"

_Settings = TypeVar("_Settings", bound=Any)
_Command = TypeVar("_Command", bound=Callable[..., Any])


FOLDER = click.Path(file_okay=False, path_type=Path)
FILE = click.Path(dir_okay=False, path_type=Path)


def names(
    _context: click.Context, _parameter: click.Parameter, text: str | None
) -> tuple[str, ...] | None:
    """Callback of an option: a list like ``a,b``, each once."""
    if text is None:
        return None
    return tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def numbers(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[int, ...] | None:
    """Callback of an option: a list like ``16,32``, each once."""
    parts = names(context, parameter, text)
    try:
        return None if parts is None else tuple(dict.fromkeys(map(int, parts)))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a list of numbers like 16,32") from error


def out_option(folder: str, what: str) -> Callable[[_Command], _Command]:
    """``--out``: the folder for what the benchmark writes, ``build/FOLDER`` by default."""
    return click.option(
        "--out",
        type=FOLDER,
        default=BUILD / folder,
        help=f"Folder for {what}; default: build/{folder} in the checkout.",
    )


def docs_option(what: str) -> Callable[[_Command], _Command]:
    """``--docs``: the folder of the documentation."""
    return click.option(
        "--docs",
        type=FOLDER,
        help=f"Folder for {what} too; default: the documentation, if no other option is given.",
    )


def quick_option(what: str) -> Callable[[_Command], _Command]:
    """``--quick``: a rough run, to see that it works; it never writes documentation."""
    return click.option(
        "--quick", is_flag=True, help=f"{what}, in about a minute; other options refine it."
    )


def page_only_option() -> Callable[[_Command], _Command]:
    """``--page-only``: for new words in a page whose measurements take long."""
    return click.option(
        "--page-only",
        is_flag=True,
        help="Measure nothing: write the page in the documentation anew from the data beside it.",
    )


def chosen(base: _Settings, options: Mapping[str, object]) -> _Settings:
    """Settings, changed by the options that were given."""
    return replace(base, **{name: value for name, value in options.items() if value is not None})


def docs_folder(given: Path | None, *, standard: bool, quick: bool = False) -> Path | None:
    """Where documentation is written: only what the standard settings find belongs there.

    Args:
        given: the value of ``--docs``.
        standard: whether all settings are the standard ones.
        quick: whether ``--quick`` was given.

    Raises:
        click.UsageError: if ``--docs`` was given with ``--quick``.
    """
    if quick and given is not None:
        raise click.UsageError("--quick can't be used together with --docs: its results are rough")
    return DOCS if given is None and standard else given


def output_folders(out: Path, docs: Path | None, inside: str = "results") -> list[Path]:
    """Where a benchmark writes: ``out``, and the folder ``inside`` the documentation.

    To be called before the minutes of measuring, not after them.

    Raises:
        NotWritable: naming the folder.
    """
    folders = [out, *([docs / inside] if docs is not None else [])]
    for folder in folders:
        ensure_writable_folder(folder)
    return folders


def write_results(folders: Iterable[Path], contents: Mapping[str, str | bytes]) -> None:
    """Write files by name into each of the folders, and say so; raise NotWritable if one can't."""
    for folder in folders:
        ensure_writable_folder(folder)
        write_files_atomically(
            folder,
            {
                name: content.encode() if isinstance(content, str) else content
                for name, content in contents.items()
            },
        )
        click.echo(f"wrote {' and '.join(contents)} to {folder}")


def write_table(name: str, lines: Sequence[str], folders: Iterable[Path]) -> None:
    """Show a page of a table, and write it as ``NAME.md``; raise NotWritable if it can't be."""
    text = "\n".join(lines) + "\n"
    click.echo(text)
    write_results(folders, {f"{name}.md": text})


def rewrite_page(
    docs: Path | None, page: str, data: str, text_of: Callable[[Mapping[str, Any]], str]
) -> None:
    """Write a page in results/ of the documentation anew, from the data beside it."""
    folder = (docs or DOCS) / "results"
    write_file(folder / page, text_of(json.loads((folder / data).read_text("utf-8"))))


def run(command: click.Command, name: str) -> None:
    """Run a command line; a fault that annik knows is one line and exit code 1."""
    try:
        command(prog_name=name)
    except AnnikError as error:
        click.echo(f"annik: {one_line(error)}", err=True)
        sys.exit(1)

"""``./run paper``: options, progress and the files that it leaves."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.command_line import docs_folder, docs_option, out_option


@click.command()
@out_option("paper", "results.json, tables, figures and the page")
@docs_option("the page and its figures")
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=2026,
    show_default=True,
    help="The master seed, from which all others are drawn.",
)
@click.option("--workers", type=click.IntRange(1), help="Processes; default: one per processor.")
@click.option("--quick", is_flag=True, help="All parts, roughly, in about a minute.")
def paper(out: Path, docs: Path | None, seed: int, workers: int | None, quick: bool) -> None:
    """Reproduce the published method: every table and figure of the paper."""
    # Slow to load: --help does without.
    from benchmarks.paper.files import PAGE, RESULTS, check_writable, write_reproduction
    from benchmarks.paper.reproduction import PaperSettings, measure

    settings = PaperSettings.quick(seed) if quick else PaperSettings(seed)
    docs = docs_folder(docs, standard=settings == PaperSettings(), quick=quick)
    check_writable(*(folder for folder in (out, docs) if folder is not None))
    with Progress(
        TextColumn("reproducing the paper"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("jobs"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
    ) as progress:
        task = progress.add_task("", total=None)
        measured = measure(
            settings,
            workers or -1,
            lambda done, jobs: progress.update(task, completed=done, total=jobs),
        )
    write_reproduction(measured, out, docs)
    Console().print(
        f"wrote {PAGE}, {RESULTS}, tables and figures to {escape(str(out))}"
        + (f", the page to {escape(str(docs))} too" if docs else ""),
        soft_wrap=True,
    )

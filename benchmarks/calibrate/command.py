"""``./run bench calibrate``: options, and the files that it leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from benchmarks.calibrate.methods import METHODS
from benchmarks.calibrate.page import figure, page, short_page
from benchmarks.calibrate.problems import cached_sets
from benchmarks.calibrate.run import Job, Outcome, Settings, jobs_of, run_all
from benchmarks.command_line import (
    FOLDER,
    ROOT,
    chosen,
    docs_folder,
    docs_option,
    names,
    numbers,
    out_option,
    output_folders,
    quick_option,
    write_results,
    write_table,
)

DATA = ROOT.parent / "shared" / "data"
FIGURE = "calibrate.png"
_STANDARD = Settings()
_QUICK = Settings(sizes=(50,), splits=1)


@click.command()
@click.argument("folder", type=FOLDER, default=DATA)
@click.option("--sets", callback=names, help="Names of folders in measured/ and sockets/.")
@click.option("--methods", callback=names, help=f"Of {', '.join(METHODS)}; default all.")
@click.option("--sizes", callback=numbers, help="Rows to calibrate with.")
@click.option("--splits", type=click.IntRange(1), help=f"Default {_STANDARD.splits}.")
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Processes.")
@quick_option("One split of 50 rows")
@out_option("calibrate", "results, tables and figure. What is there is not measured again")
@docs_option("the tables, in results/ there, and the figure, in images/,")
def calibrate(
    folder: Path, workers: int, quick: bool, out: Path, docs: Path | None, **choices: Any
) -> None:
    """Calibrate real arms from public measurements, by annik and by others.

    FOLDER has measured/SET with a table and a URDF, and sockets/ROBOT/PLACEMENT/hole_0.csv with
    sockets/nominal/ROBOT.urdf; default: ../shared/data beside the checkout.
    """
    settings = chosen(_QUICK if quick else _STANDARD, choices)
    standard = settings == _STANDARD and folder == DATA
    sets = [
        one
        for one in cached_sets(folder).values()
        if not settings.sets or one.name in settings.sets
    ]
    if not sets:
        click.echo(f"no measurements in {folder}: nothing is compared")
        return
    for name in settings.methods:
        if name not in METHODS:
            raise click.BadParameter(f"no method {name!r}: {', '.join(METHODS)}")
    docs = docs_folder(docs, standard=standard, quick=quick)
    folders, image_folders = output_folders(out, docs), output_folders(out, docs, "images")

    def tell(job: Job, outcome: Outcome) -> None:
        mean = outcome.refused or f"{1e3 * (outcome.mean or 0.0):.3f} mm"
        click.echo(f"{job.name} {job.size} {job.split} {job.method}: {mean}")

    outcomes = run_all(jobs_of(folder, sets, settings), out / "outcomes.jsonl", workers, tell)
    write_table("calibrate", page(sets, settings, outcomes), folders)
    write_table("calibrate_short", short_page(sets, settings, outcomes), folders)
    write_results(image_folders, {FIGURE: figure(sets, settings, outcomes)})

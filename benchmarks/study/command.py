"""``./run study``: options, what it shows in the terminal, and the files that it leaves.

Slow modules are loaded in the functions that use them, so that Ctrl-C is handled from the start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from annik_core.errors import AnnikError
from annik_core.files import ensure_writable_folder, write_files_atomically
from benchmarks.command_line import docs_folder, docs_option, names, numbers, out_option

if TYPE_CHECKING:
    from benchmarks.study.run import Runner, StudyOutcome, StudyProgress
    from benchmarks.study.summary import SummaryRow

#: Exit code of a program that Ctrl-C stopped.
INTERRUPTED = 130
#: Jobs differ by a factor of a hundred in time: what remains is guessed from many of them [s].
_SPEED_PERIOD = 600.0
_SHOWN_FAILURES = 5


class EveryJobFailed(AnnikError):
    """A study has no outcome at all."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        super().__init__(f"all {jobs} jobs failed: see above")


@click.command()
@out_option(
    "study", "results, summary, page and figures. Jobs whose results are there are not run again"
)
@docs_option("the page and its figures")
@click.option(
    "--systems",
    callback=names,
    help="F, elbow_arm, interaction, robots or definitions (.yaml); default gantry,F,elbow_arm.",
)
@click.option(
    "--designs",
    callback=names,
    help="Of thirty_phase, thirty_phase_plus, workspace_grid, central_composite, "
    "latin_hypercube, sobol, random, active and identifiability; default all.",
)
@click.option(
    "--training",
    callback=names,
    help="Of plain, linear_path, sobolev, bayesian and sobolev_bayesian; default all.",
)
@click.option(
    "--examples",
    callback=numbers,
    help="How many, or the nearest that a design can have; default 16,32,64,128.",
)
@click.option("--seeds", type=int, help="How often to repeat each combination (default 5).")
@click.option("--max-evaluations", type=int, help="Residuals per fit (default 50).")
@click.option("--workers", type=click.IntRange(1), help="Processes; default: one per processor.")
@click.option(
    "--backend",
    type=click.Choice(["processes", "dask"]),
    default="processes",
    help="Where the jobs run: processes of this machine, or a Dask cluster.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Of the Dask cluster, as tcp://HOST:8786; default: a cluster on this machine.",
)
@click.option("--quick", is_flag=True, help="A rough study of a minute; other options refine it.")
def study(
    out: Path,
    docs: Path | None,
    workers: int | None,
    backend: str,
    scheduler: str | None,
    quick: bool,
    **choices: Any,
) -> None:
    """Compare designs and ways to train: error against number of examples.

    Runs every design x training x system x number of examples x seed, as independent jobs. A
    study that was stopped goes on where it was when the same command is given again.
    """
    if scheduler is not None and backend != "dask":
        raise click.UsageError("--scheduler needs --backend dask")
    if scheduler is not None and workers is not None:
        raise click.UsageError("--workers is for this machine; a cluster has its own workers")
    given = {name: value for name, value in choices.items() if value is not None}
    docs = docs_folder(docs, standard=not (given or quick), quick=quick)
    display = _Display(Console(stderr=True), out)
    try:
        outcome = display.run(given, quick, _runner(backend, scheduler, workers or -1))
        _report(outcome, out, docs)
    except KeyboardInterrupt:
        display.say(f"stopped; {display.count}run the same command to go on")
        click.get_current_context().exit(INTERRUPTED)


def _runner(backend: str, scheduler: str | None, workers: int) -> Runner:
    """What runs the jobs."""
    from benchmarks.jobs.dask_runner import run_jobs_on_dask
    from benchmarks.jobs.job_runner import run_jobs

    if backend == "dask":
        return partial(run_jobs_on_dask, scheduler=scheduler, workers=workers)
    return partial(run_jobs, workers=workers)


class _Display:
    """Says what a study does while it does it."""

    def __init__(self, console: Console, folder: Path) -> None:
        self._console = console
        self._folder = folder
        self._latest: StudyProgress | None = None

    @property
    def count(self) -> str:
        """How many jobs are done, if that is known, as the beginning of a sentence."""
        if self._latest is None:
            return ""
        return f"{self._latest.done} of {self._latest.jobs} jobs done; "

    def say(self, text: str) -> None:
        """One line, however long."""
        self._console.print(f"annik: {escape(text)}", soft_wrap=True, highlight=False)

    def run(self, given: Mapping[str, Any], quick: bool, runner: Runner) -> StudyOutcome:
        """Run the study with a progress bar."""
        from benchmarks.study.run import run_study
        from benchmarks.study.settings import StudySettings

        settings = replace(StudySettings.quick() if quick else StudySettings(), **given)
        with Progress(
            TextColumn("fitting"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("jobs{task.fields[failed]},"),
            TimeElapsedColumn(),
            TextColumn("gone,"),
            TimeRemainingColumn(),
            TextColumn("to go"),
            console=self._console,
            speed_estimate_period=_SPEED_PERIOD,
        ) as progress:
            task = progress.add_task("", total=None, failed="")

            def on_progress(now: StudyProgress) -> None:
                if self._latest is None:
                    self._begin(now)
                    # The jobs of earlier runs say nothing of the speed of this one.
                    progress.reset(task, total=now.jobs, completed=now.done)
                failed = f" ({now.failed} failed)" if now.failed else ""
                progress.update(task, completed=now.done + now.failed, failed=failed)
                self._latest = now

            return run_study(settings, self._folder, runner, on_progress)

    def _begin(self, start: StudyProgress) -> None:
        if start.truncated:
            self.say(
                f"the last line of the results in {self._folder} was incomplete and has been "
                "taken off; its job is run again"
            )
        if start.done_before:
            self.say(
                f"{start.done_before} of {start.jobs} jobs were done before, in {self._folder}"
            )


def _report(outcome: StudyOutcome, folder: Path, docs: Path | None) -> None:
    """Write summary, page and figures, and say what was best."""
    from benchmarks.study.figures import efficiency_plot
    from benchmarks.study.page import IMAGES, figure_name, study_page
    from benchmarks.study.summary import as_csv, summarise

    console = Console()
    for line in outcome.left_out:
        console.print(f"left out: {escape(line)}", soft_wrap=True)
    _print_failures(outcome, console)
    if not outcome.outcomes:
        raise EveryJobFailed(len(outcome.failures))
    rows = summarise(outcome.outcomes)
    systems = list(dict.fromkeys(row.system for row in rows))
    figures = {
        figure_name(system): efficiency_plot(
            [row for row in rows if row.system == system], outcome.settings.examples
        )
        for system in systems
    }
    for place in (folder, docs):
        if place is not None:
            _write(place / IMAGES, figures)
            page = study_page(outcome, rows, in_docs=place == docs)
            _write(place, {"study.md": page.encode()})
    _write(folder, {"summary.csv": as_csv(rows).encode()})
    for system in systems:
        console.print(
            _best_table([row for row in rows if row.system == system], outcome.settings.examples)
        )
    seconds = [job.seconds for job in outcome.outcomes.values()]
    console.print(
        f"{len(seconds)} jobs took {sum(seconds):.0f} s of processor time: "
        f"{sum(seconds) / len(seconds):.2f} s a job, {max(seconds):.2f} s the longest",
        highlight=False,
    )
    console.print(
        f"wrote summary.csv, study.md and its figures to {escape(str(folder))}"
        + (f", the last two to {escape(str(docs))} too" if docs else ""),
        soft_wrap=True,
    )


def _print_failures(outcome: StudyOutcome, console: Console) -> None:
    if not outcome.failures:
        return
    total = len(outcome.outcomes) + len(outcome.failures)
    console.print(
        f"{len(outcome.failures)} of {total} jobs failed and are tried again by the same command:"
    )
    for job, reason in list(outcome.failures.items())[:_SHOWN_FAILURES]:
        what = f"{job.system}, {job.design} {job.size}, {job.training}, seed {job.seed}"
        console.print(escape(f"  {what}: {reason}"), soft_wrap=True)
    if len(outcome.failures) > _SHOWN_FAILURES:
        console.print("  ...")


def _best_table(rows: list[SummaryRow], budgets: tuple[int, ...]) -> Table:
    from benchmarks.study.summary import best_within, error_text

    unit = f" [{rows[0].unit}]" if rows[0].unit else ""
    table = Table(
        "at most",
        "design",
        "training",
        "examples",
        escape(f"rms error{unit}"),
        title=escape(f"{rows[0].system}: least median errors"),
    )
    for budget in sorted(budgets):
        best = best_within(rows, budget)
        if best is not None:
            table.add_row(
                str(budget),
                best.design,
                best.training,
                str(best.examples),
                error_text(best.rms_error.median),
            )
    return table


def _write(folder: Path, contents: Mapping[str, bytes]) -> None:
    ensure_writable_folder(folder)
    write_files_atomically(folder, contents)

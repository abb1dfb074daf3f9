"""``./run bench ik``: options, what it shows in the terminal, and the files that it leaves."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)

from annik_core.errors import AnnikError
from annik_core.installation import share_directory
from annik_core.model.artifact import load_model
from annik_core.robots.library import load_robot
from benchmarks.command_line import (
    FILE,
    chosen,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    page_only_option,
    quick_option,
    rewrite_page,
    write_results,
)
from benchmarks.ik.page import bench_page
from benchmarks.ik.results import QUICK, BenchResults, BenchSettings
from benchmarks.ik.robot_problem import robot_problem
from benchmarks.ik.run import run_bench
from benchmarks.ik.terminal import print_results
from benchmarks.ik.whole_robot import WholeResults, measure_whole_robots
from benchmarks.ik.whole_robot_page import whole_robot_page
from benchmarks.plain_data import built

PAGE = "ik_bench.md"
DATA = "ik_bench.json"
WHOLE_PAGE, WHOLE_DATA = "ik_whole_robot.md", "ik_whole_robot.json"
PARTS = BOX, WHOLE = "box", "whole_robot"
_FILE_WIDTH = 120
_STANDARD = BenchSettings()


class NoModelForBench(AnnikError):
    """There is no packaged model of the robot, and no other was given."""

    def __init__(self, robot: str, path: Path) -> None:
        self.robot = robot
        self.path = path
        super().__init__(
            f"there is no packaged model of {robot} ({path}): train one with "
            f"'annik train --robot {robot} --out {path.name}' and give it with "
            f"--model {path.name}"
        )


@click.command()
@click.option(
    "--robot",
    "robot_name",
    default="ur5e",
    show_default=True,
    help="An arm: packaged, or a definition or URDF.",
)
@click.option("--model", type=FILE, help="Its model file (.onnx); default: the packaged one.")
@click.option(
    "--targets", type=click.IntRange(1), help=f"Random poses (default {_STANDARD.targets})."
)
@click.option(
    "--paths", type=click.IntRange(1), help=f"Straight lines (default {_STANDARD.paths})."
)
@click.option(
    "--points", type=click.IntRange(2), help=f"On each line (default {_STANDARD.points})."
)
@click.option(
    "--rounds",
    type=click.IntRange(1),
    help="How often each solver is timed on each target; the median counts "
    f"(default {_STANDARD.rounds}).",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    help=f"Of targets and lines, apart from those of training (default {_STANDARD.seed}).",
)
@click.option(
    "--recall-poses",
    type=click.IntRange(1),
    help=f"Of a whole robot, whose solutions are all sought (default {_STANDARD.recall_poses}).",
)
@click.option(
    "--restarts",
    type=click.IntRange(1),
    help=f"Of a reference on each of these (default {_STANDARD.restarts}).",
)
@click.option(
    "--part",
    type=click.Choice(PARTS),
    help="One robot in its joint box, or several whole robots (default: both).",
)
@quick_option("Everything, roughly")
@page_only_option()
@out_option("bench", "page and data")
@docs_option("page and data, in results/ there,")
def ik(
    robot_name: str,
    model: Path | None,
    part: str | None,
    quick: bool,
    page_only: bool,
    out: Path,
    docs: Path | None,
    **amounts: int | None,
) -> None:
    """Inverse kinematics: annik and the solvers of others on the same targets.

    Success, branch, times, straight paths and throughput of every solver that is installed; the
    others are skipped and named. `./run bench ik` installs them all, in an environment of their
    own. The same of five whole robots: poses of the full joint range, all solutions, paths that
    are followed.
    """
    if page_only:
        rewrite_page(docs, PAGE, DATA, lambda data: bench_page(BenchResults.from_dict(data)))
        rewrite_page(
            docs,
            WHOLE_PAGE,
            WHOLE_DATA,
            lambda data: whole_robot_page(built(WholeResults, data)),
        )
        return
    settings = chosen(QUICK if quick else _STANDARD, amounts)
    standard = settings == _STANDARD and robot_name == "ur5e" and model is None
    docs = docs_folder(docs, standard=standard, quick=quick)
    folders = output_folders(out, docs)
    if part != WHOLE:
        robot = load_robot(robot_name)
        robot_problem(robot)
        artifact = load_model(model or _packaged_model(robot.name), robot)
        with _progress() as progress:
            results = run_bench(artifact, settings, _Shown(progress))
        console = Console()
        # A file or a pipe has no width of its own, and rich would take 80 columns for it.
        print_results(results, console if console.is_terminal else Console(width=_FILE_WIDTH))
        write_results(folders, {PAGE: bench_page(results), DATA: _json(results.to_dict())})
    if part != BOX:
        with _progress() as progress:
            whole = measure_whole_robots(settings, _Shown(progress))
        page = whole_robot_page(whole)
        click.echo(page)
        write_results(folders, {WHOLE_PAGE: page, WHOLE_DATA: _json(asdict(whole))})


def _json(data: object) -> str:
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        # Each redraw takes time from the solvers; and none is in the midst of one.
        auto_refresh=False,
    )


def _packaged_model(robot: str) -> Path:
    path = share_directory() / "models" / f"{robot}.onnx"
    if not path.is_file():
        raise NoModelForBench(robot, path)
    return path


class _Shown:
    """A bar for each part of the run, drawn anew at most a hundred times."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}

    def __call__(self, part: str, done: int, total: int) -> None:
        """See :data:`benchmarks.ik.run.OnProgress`."""
        if part not in self._tasks:
            self._tasks[part] = self._progress.add_task(part, total=total)
        if done == total or done % max(1, total // 100) == 0:
            self._progress.update(self._tasks[part], completed=done, refresh=True)

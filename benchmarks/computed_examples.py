"""How many computed examples a whole robot needs, by their design of experiments.

The search in NumPy, with other examples in place of its own. All else is as it is: what is left
undone by the examples the starts after them do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import click
import numpy as np
from matplotlib.figure import Figure
from rich.progress import track
from scipy.stats import qmc

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.solver.plain_search import PlainSearch
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import SearchOptions
from annik_core.solver.whole_robot import readable_search
from annik_training.cli.plots import png
from benchmarks.command_line import (
    chosen,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    write_results,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table
from benchmarks.robots.folder import ArmFile
from benchmarks.robots.oracle import Oracle

PAGE, FIGURE = "computed_examples.md", "study_computed_examples.png"
SEQUENCE = "the sequence of the search"
#: Starts that the first answer may take: the nearest examples.
NEAREST = 8
#: By name: from a number of joints and of examples to points ``(n, joints)`` between 0 and 1.
DESIGNS: Mapping[str, Callable[[int, int], FloatArray]] = MappingProxyType(
    {
        "latin_hypercube": lambda joints, count: qmc.LatinHypercube(joints, seed=0).random(count),
        "random": lambda joints, count: np.random.default_rng(0).uniform(size=(count, joints)),
    }
)
_COLUMNS = (
    f"answered from the nearest {NEAREST} [%]",
    "recall of all solutions [%]",
    "starts for all solutions, mean",
)


@dataclass(frozen=True)
class _Settings:
    poses: int = 300
    recall_poses: int = 25
    examples: tuple[int, ...] = (500, 2000, 5000, 20_000)


@dataclass(frozen=True)
class _Row:
    design: str
    examples: int
    values: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class _Designed(PlainSearch):
    rows: FloatArray

    @cached_property
    def _examples(self) -> FloatArray:
        return self.rows


@click.command("computed_examples")
@click.option("--robot", "name", default="ur5e", show_default=True, help="A packaged arm.")
@click.option("--poses", type=click.IntRange(1), help=f"Random (default {_Settings.poses}).")
@click.option(
    "--recall-poses",
    type=click.IntRange(1),
    help=f"Of these, for the recall (default {_Settings.recall_poses}).",
)
@quick_option("Few poses")
@out_option("bench", "page and figure")
@docs_option("page and figure")
def computed_examples(
    name: str, quick: bool, out: Path, docs: Path | None, **amounts: int | None
) -> None:
    """Answered poses and recall of a whole robot, by number and design of computed examples."""
    standard = _Settings()
    settings = chosen(_Settings(40, 3, (500, 2000)) if quick else standard, amounts)
    docs = docs_folder(docs, standard=settings == standard and name == "ur5e", quick=quick)
    tables, figures = output_folders(out, docs), output_folders(out, docs, "images")
    described = load_robot(name)
    urdf = str(described.definition["urdf"])
    frames = described.base_frame, described.end_effector_frame
    robot = load_robot(urdf, base_frame=frames[0], end_effector_frame=frames[1])
    rows = _measured(robot, Oracle.of(ArmFile(name, urdf, *frames)), settings)
    text = _page(name, rows, settings)
    click.echo(text)
    write_results(tables, {PAGE: text})
    write_results(figures, {FIGURE: png(_figure(rows))})


def _measured(robot: Robot, oracle: Oracle, settings: _Settings) -> list[_Row]:
    rng = np.random.default_rng(2026)
    poses = robot.forward_kinematics.poses(robot.joint_box.sample(settings.poses, rng))
    few, none = poses[: settings.recall_poses], np.empty((0, robot.dof))
    options = SearchOptions()
    found: list[tuple[str, int, float, list[FloatArray], list[int]]] = []
    cases = [(name, count) for name in (SEQUENCE, *DESIGNS) for count in settings.examples]
    for design, count in track(cases, "designs"):
        search = _search(robot, design, count)
        answered = [search.first(pose, none, NEAREST).found for pose in poses]
        every = [search.all(pose, none, options.max_starts, options.spacing) for pose in few]
        solutions = [
            oracle.distinct(oracle.refined(one.joint_positions, pose))
            for one, pose in zip(every, few, strict=True)
        ]
        starts = [one.starts for one in every]
        found.append((design, count, float(np.mean(answered)), solutions, starts))
    known = [
        len(oracle.distinct(np.vstack(of_pose)))
        for of_pose in zip(*(f[3] for f in found), strict=True)
    ]
    return [
        _Row(
            design,
            count,
            (
                100.0 * answered,
                100.0
                * float(np.mean([len(a) / n for a, n in zip(solutions, known, strict=True) if n])),
                float(np.mean(starts)),
            ),
        )
        for design, count, answered, solutions, starts in found
    ]


def _search(robot: Robot, design: str, count: int) -> PlainSearch:
    plain = readable_search(robot, RefinementOptions(), count)
    assert isinstance(plain, PlainSearch)
    if design == SEQUENCE:
        return plain
    box = robot.joint_box
    rows = box.lower + DESIGNS[design](robot.dof, count) * (box.upper - box.lower)
    return _Designed(**vars(plain), rows=rows)


def _page(name: str, rows: list[_Row], settings: _Settings) -> str:
    cells = [
        (row.design, f"{row.examples:,}", *(f"{value:.1f}" for value in row.values))
        for row in rows
    ]
    return "\n".join(
        [
            "<!-- Written by ./run bench computed_examples -->",
            "",
            markdown_table(("design", "examples", *_COLUMNS), cells, 4),
            "",
            f"{settings.poses:,} poses of the {name} anywhere within its joint limits, the recall "
            f"on {settings.recall_poses} of them, against what the searches with all designs find "
            "together.",
            "",
            machine(),
            "",
        ]
    )


def _figure(rows: list[_Row]) -> Figure:
    figure = Figure(figsize=(9.0, 2.8), dpi=150, layout="constrained")
    for panel, (title, axes) in enumerate(zip(_COLUMNS, figure.subplots(1, 3), strict=True)):
        for design, marker in zip((SEQUENCE, *DESIGNS), "osv", strict=True):
            series = [row for row in rows if row.design == design]
            counts = [row.examples for row in series]
            axes.plot(counts, [row.values[panel] for row in series], marker=marker, label=design)
        axes.set_xscale("log")
        axes.set_xticks(counts, [f"{count:,}" for count in counts], fontsize=7)
        axes.minorticks_off()
        axes.tick_params(labelsize=7)
        axes.set_title(title, fontsize=8)
        axes.set_xlabel("computed examples", fontsize=8)
        axes.grid(alpha=0.3)
    axes.legend(fontsize=7)
    return figure

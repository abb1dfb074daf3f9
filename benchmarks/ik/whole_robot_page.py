"""The page about whole robots, in Markdown."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.ik.whole_robot import FAR, WholeArm, WholeResults
from benchmarks.markdown import markdown_table


def whole_robot_page(results: WholeResults) -> str:
    """The page: a column for each arm."""
    settings, arms = results.settings, results.arms
    paths = max((found.paths for arm in arms for found in arm.paths.values()), default=0)
    poses = max(arm.poses for arm in arms)

    def first(title: str, cell: Callable[[WholeArm, str], str], *about: str) -> list[str]:
        names = [solver.name for solver in results.solvers]
        return [f"#### {title}", _table(results, names, cell), *about]

    listing = list(dict.fromkeys(name for arm in arms for name in arm.every))
    rows = [
        (
            name,
            arm.name,
            f"{found.solutions:.1f}",
            *(
                "" if share is None else _percent(share)
                for share in (found.recall, found.complete)
            ),
            *(
                f"{spent:.0f}" if arm.targets.get(name) else ""
                for spent in (found.median_us, found.p99_us)
            ),
        )
        for name in listing
        for arm in arms
        if (found := arm.every.get(name)) is not None
    ]
    columns = (
        *("solver", "arm", "solutions, mean", "recall [%]", "poses with all solutions [%]"),
        *("median [us]", "p99 [us]"),
    )
    parts = [
        "<!-- Written by ./run bench ik -->",
        *first(
            "The whole robot: poses answered [%]",
            lambda arm, name: _percent(arm.targets[name].in_limits),
            f"{settings.targets:,} poses of each arm, from joint positions anywhere within its "
            "limits: 1e-6 m and 1e-6 rad by an independent forward kinematics, within the "
            "limits. Where a cell is empty, the solver can't do the arm. The calibrated ur5e has "
            "links and axes that are off by half a millimetre and half a milliradian, and every "
            "solver has its right URDF. Solvers with a time limit find less on a loaded machine.",
        ),
        *first(
            "The whole robot: time of the first solution, median and p99 [us]",
            lambda arm, name: ", ".join(
                f"{value:.0f}" for value in (arm.targets[name].median_us, arm.targets[name].p99_us)
            ),
        ),
        "#### The whole robot: all solutions",
        markdown_table(columns, rows, len(columns) - 2),
        f"Of {poses} poses of each arm. Recall: the mean share of all solutions that any of these "
        f"solvers or {settings.restarts:,} random starts of an independent Newton's method find. "
        "An arm with seven joints has infinitely many; annik lists a sample. Solvers that are not "
        "in the table find one solution only. Newton's method after a closed form is in NumPy: "
        "its time says nothing. Times are of the processor: others share the machine.",
        *first(
            "The whole robot: paths followed, and branch changes",
            lambda arm, name: _path(arm, name),
            f"{paths} straight lines of {settings.points} points, each from a random pose to that "
            f"of joint positions within {FAR:g} rad, that can be followed without a jump within "
            "the limits. Each solver begins at its previous solution, a closed form chooses the "
            "nearest to it. Followed: every point is answered, right and within the limits. "
            "Branch changes: lines with a joint step of more than 1.5 times the largest that is "
            "needed, and 0.02 rad more than it.",
        ),
        str(results.conditions),
    ]
    return "\n\n".join(parts) + "\n"


def _table(results: WholeResults, names: list[str], cell: Callable[[WholeArm, str], str]) -> str:
    rows = [
        [name, *(cell(arm, name) if name in arm.targets else "" for arm in results.arms)]
        for name in names
    ]
    header = ("solver", *(arm.name for arm in results.arms))
    return markdown_table(header, rows, len(results.arms))


def _path(arm: WholeArm, name: str) -> str:
    found = arm.paths.get(name)
    return "" if found is None else f"{found.solved}, {found.changing}"


def _percent(share: float) -> str:
    """Two digits after the point; never 100 for less than all."""
    return "100" if share == 1.0 else f"{int(1e4 * share + 1e-9) / 100:.2f}"

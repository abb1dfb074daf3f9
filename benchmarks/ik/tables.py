"""The tables, as cells of text and whether each is among the best: for page and terminal alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from benchmarks.ik.measure import TargetResult
from benchmarks.ik.measure_alone import AloneResult
from benchmarks.ik.measure_paths import PathResult
from benchmarks.ik.results import BenchResults, SolverEntry

#: A solver that solves fewer of the targets takes no part in the comparison of times, rates and
#: steps: to be quick and wrong, or to give up, is no merit.
COMPARABLE = 0.5

Found = TypeVar("Found")


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
        text: what it says.
        best: whether it is the best of its column, among the numerical solvers or among all.
    """

    text: str
    best: bool = False


@dataclass(frozen=True)
class BenchTable:
    """A table.

    Attributes:
        title: what it is about.
        columns: their headings.
        rows: as many cells each.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True)
class _Column(Generic[Found]):
    """A column of numbers.

    Attributes:
        heading: with the unit.
        value: taken from what was found.
        text: of the value.
        high: whether a high value is good.
        of_all: whether solvers that solve few targets take part.
    """

    heading: str
    value: Callable[[Found], float]
    text: Callable[[float], str]
    high: bool = False
    of_all: bool = False


def bench_tables(results: BenchResults) -> list[BenchTable]:
    """Targets, times alone, paths (where there are some), throughput, and a calibrated robot."""
    tables = [
        _table("Targets", results, results.targets, _TARGETS),
        _table("Each solver alone", results, results.alone, _ALONE),
    ]
    if results.paths:
        tables.append(_table("Straight paths", results, results.paths, _PATHS))
    sizes = next(iter(results.throughput.values())).keys()
    throughput = [
        _Column[Mapping[int, float]](
            f"{size} pose{'s' if size > 1 else ''} [1/s]",
            lambda rates, size=size: rates[size],  # type: ignore[misc]
            lambda rate: f"{float(f'{rate:.2g}'):.0f}",
            high=True,
        )
        for size in sizes
    ]
    tables.append(_table("Throughput", results, results.throughput, throughput))
    one = results.threads[1]
    rows = [
        [Cell(f"{threads}"), Cell(f"{float(f'{rate:.2g}'):.0f}"), Cell(f"{rate / one:.2f}")]
        for threads, rate in results.threads.items()
    ]
    columns = ("threads", f"{max(sizes)} poses [1/s]", "as one thread")
    tables.append(BenchTable("Batches of annik, refined, by threads", columns, rows))
    others = results.calibrated
    return [*tables, _table("A calibrated robot", results, others, _TARGETS, others)]


def _table(
    title: str,
    results: BenchResults,
    found: Mapping[str, Found],
    columns: Sequence[_Column[Found]],
    solved: Mapping[str, TargetResult] | None = None,
) -> BenchTable:
    solvers = [solver for solver in results.all_solvers if solver.name in found]
    comparable = {
        name
        for name, result in (solved or results.targets).items()
        if result.success >= COMPARABLE
    }
    rows = [[Cell(solver.name), Cell(solver.kind)] for solver in solvers]
    for column in columns:
        shown = {name: column.text(column.value(found[name])) for name in found}
        competing = [solver for solver in solvers if column.of_all or solver.name in comparable]
        numerical = [solver for solver in competing if solver.kind != "closed form"]
        best = _best(column, found, shown, competing) | _best(column, found, shown, numerical)
        for row, solver in zip(rows, solvers, strict=True):
            row.append(Cell(shown[solver.name], solver.name in best))
    return BenchTable(title, ("solver", "kind", *(column.heading for column in columns)), rows)


def _best(
    column: _Column[Found],
    found: Mapping[str, Found],
    shown: Mapping[str, str],
    competing: Sequence[SolverEntry],
) -> set[str]:
    """The best of some solvers by name; values that look the same are equally good."""
    if not competing:
        return set()
    names = [solver.name for solver in competing]
    choose = max if column.high else min
    winner = choose(names, key=lambda name: column.value(found[name]))
    return {name for name in names if shown[name] == shown[winner]}


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f}"


def _microseconds(value: float) -> str:
    return f"{float(f'{value:.3g}'):.0f}" if value >= 100 else f"{value:.3g}"


_TARGETS: Sequence[_Column[TargetResult]] = (
    _Column("success [%]", lambda found: found.success, _percent, high=True, of_all=True),
    _Column("in limits [%]", lambda found: found.in_limits, _percent, high=True, of_all=True),
    _Column("in box [%]", lambda found: found.in_box, _percent, high=True, of_all=True),
    _Column("median [us]", lambda found: found.median_us, _microseconds),
    _Column("p99 [us]", lambda found: found.p99_us, _microseconds),
    _Column("worst [us]", lambda found: found.worst_us, _microseconds),
    _Column("p99 / median", lambda found: found.p99_over_median, lambda value: f"{value:.1f}"),
)
_ALONE: Sequence[_Column[AloneResult]] = (
    _Column("fastest tenth [us]", lambda found: found.fastest_tenth_us, _microseconds),
    _Column("median [us]", lambda found: found.median_us, _microseconds),
    _Column("p99 [us]", lambda found: found.p99_us, _microseconds),
    _Column("p99 / median", lambda found: found.p99_over_median, lambda value: f"{value:.1f}"),
)
_PATHS: Sequence[_Column[PathResult]] = (
    _Column("all points solved", lambda found: found.solved, "{:.0f}".format, True, True),
    _Column("branch changes", lambda found: found.changing, "{:.0f}".format),
    _Column("largest step [rad or m]", lambda found: found.largest_step, "{:.3f}".format),
    _Column("step / needed", lambda found: found.largest_ratio, "{:.1f}".format),
)

"""The page of the benchmark, in Markdown."""

from __future__ import annotations

from dataclasses import asdict

from benchmarks.ik.annik import AS_DESCRIBED, REFINED
from benchmarks.ik.measure_alone import BLOCK
from benchmarks.ik.measure_paths import FACTOR, MARGIN
from benchmarks.ik.results import QUICK, BenchResults, BenchSettings
from benchmarks.ik.tables import COMPARABLE, BenchTable, Cell, bench_tables
from benchmarks.markdown import markdown_table


def command(results: BenchResults) -> str:
    """What to type for the same."""
    settings = results.settings
    standard = asdict(QUICK if settings == QUICK else BenchSettings())
    options = ["--quick"] if settings == QUICK else []
    options += [
        f"--{name.replace('_', '-')} {value}"
        for name, value in asdict(settings).items()
        if value != standard[name]
    ]
    if not results.model.packaged:
        options.insert(0, f"--model {results.model.file}")
    if results.robot != "ur5e":
        options.insert(0, f"--robot {results.robot}")
    return " ".join(["./run bench ik", *options])


def bench_page(results: BenchResults) -> str:
    """The page."""
    targets, *others = bench_tables(results)
    typed = command(results)
    parts = [f"<!-- Written by {typed} -->", _introduction(results), _markdown(targets)]
    parts.append(_about_targets(results))
    for table in others:
        parts += [_markdown(table), _ABOUT[table.title](results)]
    parts += [_solvers(results), _skipped(results), str(results.conditions), f"Made by `{typed}`."]
    return "\n\n".join(part for part in parts if part) + "\n"


def _introduction(results: BenchResults) -> str:
    settings, model = results.settings, results.model
    return (
        f"Inverse kinematics of {results.robot}: annik and the solvers of others on the same "
        f"{settings.targets} random targets, one at a time, interleaved in one run. annik's "
        f"network is `{model.file}`: {model.examples} examples ({model.design}), hidden layers "
        f"{', '.join(map(str, model.hidden_units))}, SHA-256 {model.sha256[:12]}. In bold: the "
        "best of the numerical solvers (annik among them), and the best of all, closed forms "
        f"included. Solvers that solve less than {100 * COMPARABLE:.0f} % of the targets take no "
        "part in the comparison of times, steps and rates."
    )


def _about_targets(results: BenchResults) -> str:
    return (
        "Success: 1e-6 m and 1e-6 rad, by an independent forward kinematics; what the solver "
        "reports is ignored. In box: solved within the joint box, from which the targets come: on "
        "their branch. Whole turns of a joint are taken off first. The time of a "
        f"target is the median of {results.settings.rounds} calls, one in each of as many "
        "rounds, so that other load on the machine counts little. Solvers with a time limit "
        "find less on a loaded machine." + _faults(results)
    )


def _faults(results: BenchResults) -> str:
    named = [
        f"{name}: {fault} ({count} times)"
        for name, found in results.targets.items()
        for fault, count in found.faults.items()
    ]
    return f" Faults, counted as failed: {'; '.join(named)}." if named else ""


def _about_paths(results: BenchResults) -> str:
    found = next(iter(results.paths.values()))
    return (
        f"{found.paths} straight lines of {results.settings.points} points that can be followed "
        f"inside the box without a jump ({results.lines_tried} were tried). No solver is given "
        "its previous solution. Branch changes: lines with a joint step of more than "
        f"{FACTOR:g} times the largest that is needed, and {MARGIN:g} rad more than it. "
        "Steps are taken between the solutions that a solver returns, right or wrong."
    )


def _about_alone(_: BenchResults) -> str:
    return (
        f"The same targets, {BLOCK} in a row by one solver: its code and data stay in the "
        "processor's caches; above, each call finds there what ten other solvers left. A node is "
        "between the two. Single calls, interrupted or not; on a shared machine the fastest tenth "
        "is the nearest to an idle one."
    )


def _about_throughput(_: BenchResults) -> str:
    return "annik takes a batch in one call, on one thread; the others are called pose by pose."


def _about_threads(_: BenchResults) -> str:
    return (
        "Poses per second of one call of `solve_batch`, checks and results included; the number "
        "of threads is its argument, by default all cores that the process may use."
    )


def _about_calibrated(results: BenchResults) -> str:
    ours, as_described = (results.calibrated[name] for name in (REFINED, AS_DESCRIBED))
    return (
        "Targets of a robot with a made-up calibration (`benchmarks/ik/calibrated.py`): links and "
        "axes off by half a millimetre and half a milliradian, joints that do not turn as "
        "commanded, an arm that bends. The other solvers have a URDF of its links and axes, and "
        "so miss the rest; those that are not in the table can't do such a robot. "
        f"*{AS_DESCRIBED}* solves the same targets without the calibration, to compare the times: "
        f"annik takes {ours.median_us / as_described.median_us:.2f} times as long with it. "
        "Success is by the calibrated forward kinematics in NumPy."
    )


_ABOUT = {
    "Batches of annik, refined, by threads": _about_threads,
    "A calibrated robot": _about_calibrated,
    "Each solver alone": _about_alone,
    "Straight paths": _about_paths,
    "Throughput": _about_throughput,
}


def _solvers(results: BenchResults) -> str:
    rows = [
        [Cell(solver.name), Cell(solver.version), Cell(solver.settings)]
        for solver in results.solvers
    ]
    return _markdown(BenchTable("Solvers and settings", ("solver", "version", "settings"), rows))


def _skipped(results: BenchResults) -> str:
    if not results.skipped:
        return ""
    return "Skipped:\n\n" + "\n".join(f"- {name}: {reason}" for name, reason in results.skipped)


def _markdown(table: BenchTable) -> str:
    numbers = len(table.columns) - 2 if table.columns[1] == "kind" else 0
    rows = [[f"**{cell.text}**" if cell.best else cell.text for cell in row] for row in table.rows]
    body = markdown_table(table.columns, rows, numbers)
    return f"#### {table.title}\n\n{body}"

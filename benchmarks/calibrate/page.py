"""Tables and figure of the calibrations, from their outcomes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from annik_training.cli.plots import png
from benchmarks.calibrate.methods import METHODS
from benchmarks.calibrate.problems import MeasuredSet
from benchmarks.calibrate.run import Job, Outcome, Settings
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table

_BOUND = "within annik's 95 % bound [%]"
#: Rows of the short table.
_SHORT = 100
Outcomes = Mapping[Job, Outcome]
#: By method; others in grey.
_COLOURS = {
    "nominal": "#999999",
    "geometry": "#D55E00",
    "version 0.1": "#E69F00",
    "annik": "#0072B2",
}


def page(sets: Sequence[MeasuredSet], settings: Settings, outcomes: Outcomes) -> list[str]:
    """The lines of the page."""
    poses = [one for one in sets if not one.has_sockets]
    sockets = [one for one in sets if one.has_sockets]
    methods = ", ".join(f"{name}: {METHODS[name].meaning}" for name in settings.methods)
    lines = [
        "<!-- Written by ./run bench calibrate -->",
        "",
        f"Mean / largest error on rows that were not used; means over {settings.splits} random "
        "splits, or over the placements, each left out once. The same splits for all methods, but "
        "those that a method refused are not in its mean; the smallest mean of a line is bold. "
        f"{methods[0].upper()}{methods[1:]}. {machine()}",
    ]
    if poses:
        header = ("poses, position error [mm]", "rows", *settings.methods, _BOUND)
        rows = [
            (one.name, str(size), *_cells(mine, settings, sockets=False), _within(mine))
            for one in poses
            for size, mine in _by_size(one, outcomes)
        ]
        lines += ["", markdown_table(header, rows, len(header) - 1)]
    if sockets:
        what = "sockets, distance of the ball from its mean [mm]"
        header = (what, "rows", *settings.methods, _BOUND)
        rows = [
            (one.name, str(size), *_cells(mine, settings, sockets=True), _within(mine))
            for one in sockets
            for size, mine in _by_size(one, outcomes)
        ]
        lines += [
            "",
            "The third number is the error of the 50 mm between the sockets.",
            "",
            markdown_table(header, rows, len(header) - 1),
        ]
    return lines


def short_page(sets: Sequence[MeasuredSet], settings: Settings, outcomes: Outcomes) -> list[str]:
    """A line for each set, of 100 rows or the most below."""
    rows = []
    for one in sets:
        sizes = dict(_by_size(one, outcomes))
        size = max((size for size in sizes if size <= _SHORT), default=max(sizes))
        means = [_mean(sizes[size], name) for name in settings.methods]
        shown = [f"{1e3 * mean:.2f}" if math.isfinite(mean) else "" for mean in means]
        rows.append(
            (one.name, "ball in sockets" if one.has_sockets else "poses", str(size), *shown)
        )
    header = ("mean error on other rows [mm]", "measured", "rows", *settings.methods)
    table = markdown_table(header, rows, len(header) - 2)
    return ["<!-- Written by ./run bench calibrate -->", "", table]


def _by_size(one: MeasuredSet, outcomes: Outcomes) -> Iterator[tuple[int, dict[Job, Outcome]]]:
    for size in sorted({job.size for job in outcomes if job.name == one.name}):
        yield (
            size,
            {
                job: outcome
                for job, outcome in outcomes.items()
                if (job.name, job.size) == (one.name, size)
            },
        )


def _cells(outcomes: Outcomes, settings: Settings, *, sockets: bool) -> list[str]:
    means = {name: _mean(outcomes, name) for name in settings.methods}
    best = min((mean for mean in means.values() if math.isfinite(mean)), default=math.nan)
    cells = []
    for name, mean in means.items():
        mine = [outcome for job, outcome in outcomes.items() if job.method == name]
        refused = sum(bool(outcome.refused) for outcome in mine)
        numbers = [1e3 * mean, *_averages(mine, sockets=sockets)]
        text = " / ".join(f"{number:.3f}" for number in numbers if math.isfinite(number))
        if mean == best:
            text = f"**{text}**"
        if refused:
            text = f"{text} ({refused} of {len(mine)} refused)".strip()
        cells.append(text)
    return cells


def _averages(outcomes: Sequence[Outcome], *, sockets: bool) -> list[float]:
    worst = [outcome.worst for outcome in outcomes if outcome.worst is not None]
    apart = [outcome.angle for outcome in outcomes if outcome.angle is not None]
    parts = [worst, apart] if sockets else [worst]
    return [1e3 * float(np.mean(part)) if part else math.nan for part in parts]


def _mean(outcomes: Outcomes, method: str) -> float:
    means = [o.mean for job, o in outcomes.items() if job.method == method and o.mean is not None]
    return float(np.mean(means)) if means else math.nan


def _within(outcomes: Outcomes) -> str:
    """Positions and orientations within annik's bound."""
    parts = []
    for index in range(2):
        found = [
            outcome.within[index]
            for job, outcome in outcomes.items()
            if job.method == "annik" and outcome.within[index] is not None
        ]
        if found:
            parts.append(f"{100.0 * float(np.mean(np.array(found, dtype=float))):.0f}")
    return ", ".join(parts)


def figure(sets: Sequence[MeasuredSet], settings: Settings, outcomes: Outcomes) -> bytes:
    """Learning curves of the poses; bars of the sockets."""
    poses = [one for one in sets if not one.has_sockets]
    sockets = [one for one in sets if one.has_sockets]
    panels = len(poses) + bool(sockets)
    drawn = Figure(figsize=(3.4 * panels, 3.2), layout="constrained")
    axes = list(drawn.subplots(1, panels, squeeze=False).flat)
    for axis, one in zip(axes, poses, strict=False):
        for name in settings.methods:
            points = [(size, 1e3 * _mean(mine, name)) for size, mine in _by_size(one, outcomes)]
            axis.plot(*zip(*points, strict=True), "o-", color=_COLOURS.get(name), label=name)
        sizes = [size for size, _ in _by_size(one, outcomes)]
        axis.set(title=one.name, xlabel="rows", xscale="log", ylim=(0.0, None))
        axis.set_xticks(sizes, list(map(str, sizes)))
        axis.minorticks_off()
    if sockets:
        axis = axes[-1]
        names = [name for name in settings.methods if METHODS[name].knows_sockets]
        for index, name in enumerate(names):
            heights = [
                1e3 * _mean({j: o for j, o in outcomes.items() if j.name == one.name}, name)
                for one in sockets
            ]
            places = np.arange(len(sockets)) + 0.8 * (index - 0.5 * (len(names) - 1)) / len(names)
            axis.bar(places, heights, 0.8 / len(names), color=_COLOURS.get(name), label=name)
        axis.set_xticks(range(len(sockets)), [one.name for one in sockets], rotation=30)
        axis.set(title="ball in sockets", yscale="log", ylabel="mean distance from the mean [mm]")
    if poses:
        axes[0].set_ylabel("mean error of held-out rows [mm]")
    axes[0].legend(fontsize=8)
    return png(drawn)

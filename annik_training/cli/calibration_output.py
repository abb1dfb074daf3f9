"""What a fit to measured poses, and its evaluation, say in the terminal and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_training.calibration.calibrate import LearnedRobot
from annik_training.calibration.validation import MeasuredEvaluation

_PERCENTILES = (("mean", None), ("p50", 50), ("p95", 95), ("max", 100))


def print_learned(learned: LearnedRobot) -> None:
    """What was learned, from what, and what could not be."""
    console = Console()
    table = Table("parts of the model", "parameters", "left-out error", "")
    for candidate in learned.candidates:
        used = candidate.parts == learned.fitted.model.parts
        table.add_row(
            _parts(candidate.parts),
            str(candidate.parameters),
            f"{candidate.score:.3g} ± {candidate.standard_error:.1g}",
            "used" if used else "",
        )
    table.caption = "mean square, in squared standard deviations of the noise: 1 is all noise"
    console.print(table)
    noise = learned.fitted.noise
    console.print(
        escape(
            f"{len(learned.dataset)} measured poses of {learned.dataset.robot.name}, "
            f"{int(learned.outliers.sum())} outliers left out, {learned.seconds:.1f} s"
        )
    )
    console.print(
        f"unexplained: {1e3 * noise.position:.4f} mm and {np.degrees(noise.orientation):.5f} "
        "degrees in each coordinate"
    )
    if learned.outliers.any():
        rows = ", ".join(map(str, np.flatnonzero(learned.outliers)))
        console.print(f"outliers, by their row in the dataset: {rows}")
    if learned.unidentified:
        names = escape("; ".join(learned.unidentified))
        console.print(f"not told by these examples, left near the nominal: {names}")


def learned_summary(learned: LearnedRobot) -> dict[str, Any]:
    """The same as plain data."""
    return {
        "robot": learned.dataset.robot.name,
        "seconds": learned.seconds,
        "candidates": [
            {**asdict(candidate), "parts": sorted(part.value for part in candidate.parts)}
            for candidate in learned.candidates
        ],
        **learned.provenance,
    }


def print_evaluation(evaluation: MeasuredEvaluation, title: str) -> None:
    """Before and after, in percentiles and by joint."""
    console = Console()
    columns = [name for name, _ in _PERCENTILES]
    table = Table("error", *columns, title=escape(title))
    for model, errors in (("nominal", evaluation.before), ("learned", evaluation.after)):
        table.add_row(escape(f"{model}, position [mm]"), *_percentiles(1e3 * errors.distances))
        if evaluation.has_orientation:
            table.add_row(
                escape(f"{model}, orientation [deg]"), *_percentiles(np.degrees(errors.angles))
            )
    position, orientation = evaluation.within_bounds
    table.caption = (
        f"{len(evaluation.dataset)} held-out poses, noise of the measurements included; within "
        f"the stated 95 % bounds: {100 * position:.1f} % of the positions"
        + (
            f", {100 * orientation:.1f} % of the orientations"
            if evaluation.has_orientation
            else "; orientations were not learned"
        )
    )
    console.print(table)
    regions = Table("joint", "region", "poses", escape("nominal [mm]"), escape("learned [mm]"))
    for region in evaluation.regions:
        regions.add_row(
            escape(region.joint),
            f"{region.lower:.3g} .. {region.upper:.3g}",
            str(region.examples),
            f"{1e3 * region.before:.4g}",
            f"{1e3 * region.after:.4g}",
        )
    console.print(regions)


def evaluation_summary(evaluation: MeasuredEvaluation) -> dict[str, Any]:
    """The same as plain data; distances in metres, angles in radians.

    Of a region without examples the errors are None, and so are those of orientations that were
    not learned.
    """
    position, orientation = evaluation.within_bounds
    angles = evaluation.has_orientation
    return {
        "poses": len(evaluation.dataset),
        **{
            name: {
                "mean_position_error": float(errors.distances.mean()),
                "max_position_error": float(errors.distances.max()),
                "mean_orientation_error": float(errors.angles.mean()) if angles else None,
                "max_orientation_error": float(errors.angles.max()) if angles else None,
            }
            for name, errors in (("nominal", evaluation.before), ("learned", evaluation.after))
        },
        "positions_within_bound": position,
        "orientations_within_bound": orientation if angles else None,
        "regions": [
            {
                **region._asdict(),
                **({} if region.examples else {"before": None, "after": None}),
            }
            for region in evaluation.regions
        ],
    }


def _parts(parts: Any) -> str:
    return ", ".join(sorted(part.value for part in parts))


def _percentiles(errors: Any) -> list[str]:
    return [
        f"{errors.mean() if percent is None else np.percentile(errors, percent):.4g}"
        for _, percent in _PERCENTILES
    ]

"""``annik evaluate``: errors of a model at random poses, or at measured ones."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.errors import AnnikError
from annik_core.files import write_file
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_training.calibration.validation import MeasuredEvaluation, evaluate_measured
from annik_training.cli.options import (
    EVALUATION_POSES,
    FILE,
    PATH,
    SEED,
    SUMMARY,
    measured_dataset,
)
from annik_training.cli.output import print_evaluation, print_search_times
from annik_training.evaluation import evaluation_dataset, network_errors, search_times

#: Poses of which the times are measured: less than a second.
_TIMED_POSES = 500


@click.command()
@click.argument("model", type=PATH)
@SEED
@EVALUATION_POSES
@click.option(
    "--measured",
    type=FILE,
    help="Instead of random poses: poses measured on the robot (.npz) that a calibrated model was "
    "not calibrated with. Compares it with the nominal one.",
)
@click.option("--plot", type=FILE, help="Draw where in the joint box the errors are (.png).")
@SUMMARY
def evaluate(
    model: Path,
    seed: int,
    evaluation_poses: int,
    measured: Path | None,
    plot: Path | None,
    summary: Path | None,
) -> None:
    """Measure a model's errors at random poses, or at measured ones.

    MODEL is a model file or the name of a packaged model.
    """
    if summary is not None and measured is None:
        raise AnnikError("--summary needs --measured")
    loaded = load_model(model)
    title = f"{loaded.path}: {loaded.robot.name}"
    if measured is None:
        unseen = evaluation_dataset(loaded.robot, evaluation_poses, seed)
        errors = network_errors(loaded.joint_positions, unseen)
        print_evaluation(errors.summary(), title)
        if errors.solutions is not None:
            print_search_times(search_times(loaded, unseen.poses[:_TIMED_POSES]))
    else:
        evaluation = evaluate_measured(loaded.robot, measured_dataset(measured))
        print_measured(evaluation, title)
        if summary is not None:
            write_file(summary, json.dumps(evaluation_summary(evaluation), indent=2) + "\n")
    if plot is not None:
        from annik_training.cli.plots import before_and_after, error_map

        write_file(plot, error_map(errors) if measured is None else before_and_after(evaluation))
        click.echo(f"wrote {plot}")


def evaluation_summary(evaluation: MeasuredEvaluation) -> dict[str, Any]:
    """An evaluation at measured poses as plain data; distances [m], angles [rad].

    Errors are None in a region without poses, and of orientations that were not calibrated.
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
            {**region._asdict(), **({} if region.examples else {"before": None, "after": None})}
            for region in evaluation.regions
        ],
    }


def print_measured(evaluation: MeasuredEvaluation, title: str) -> None:
    """Print the errors before and after, in percentiles and by joint."""
    table = Table("error", "mean", "p50", "p95", "max", title=escape(title))
    for model, errors in (("nominal", evaluation.before), ("calibrated", evaluation.after)):
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
            else "; orientations were not calibrated"
        )
    )
    Console().print(table)
    regions = Table("joint", "region", "poses", escape("nominal [mm]"), escape("calibrated [mm]"))
    for region in evaluation.regions:
        regions.add_row(
            escape(region.joint),
            f"{region.lower:.3g} .. {region.upper:.3g}",
            str(region.examples),
            f"{1e3 * region.before:.4g}",
            f"{1e3 * region.after:.4g}",
        )
    Console().print(regions)


def _percentiles(errors: FloatArray) -> list[str]:
    return [f"{error:.4g}" for error in (errors.mean(), *np.percentile(errors, [50, 95, 100]))]

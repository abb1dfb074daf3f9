"""``annik calibrate``: from measured poses to the model file of a calibrated arm."""

import json
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import annik_training
from annik_core.files import ensure_writable_folder, write_file
from annik_core.robots.library import load_robot
from annik_training.cli.options import EVALUATION_POSES, FILE, SEED, SUMMARY, measured_dataset
from annik_training.cli.output import print_training
from annik_training.defaults import defaults_of

if TYPE_CHECKING:
    from annik_training import CalibratedRobot


@click.command()
@click.option(
    "--measured",
    type=FILE,
    required=True,
    help="Poses measured on the robot (.npz), as example_collector writes them.",
)
@click.option(
    "--nominal",
    help="The arm as described: packaged, a definition or URDF; default: the dataset's.",
)
@click.option(
    "--position-only",
    is_flag=True,
    help="The orientations were not measured: use the positions alone.",
)
@SEED
@click.option(
    "--examples",
    type=click.IntRange(1),
    default=512,
    show_default=True,
    help="Number of computed examples for the network, at whose output the refinement starts.",
)
@EVALUATION_POSES
@click.option("--out", type=FILE, required=True, help="The model file to write (.onnx).")
@SUMMARY
def calibrate(
    measured: Path,
    nominal: str | None,
    position_only: bool,
    seed: int,
    examples: int,
    evaluation_poses: int,
    out: Path,
    summary: Path | None,
) -> None:
    """Calibrate an arm from measured poses and write its model file.

    Corrects the geometry of the links, the joint zeros and the joints' transmissions, as far as
    the measured poses identify them. A node with this model commands the corrected robot, and the
    residuals that it reports are those of the corrected robot.
    """
    dataset = measured_dataset(measured)
    robot = dataset.robot if nominal is None else load_robot(nominal)
    for path in (out, *([] if summary is None else [summary])):
        ensure_writable_folder(path.parent)
    calibrated = annik_training.calibrate(
        robot, dataset, annik_training.CalibrationOptions(position_only=position_only, seed=seed)
    )
    _print_calibration(calibrated)
    usual = defaults_of(calibrated.robot)
    trained = annik_training.train(
        annik_training.generate_dataset(calibrated.robot, usual.design, examples, seed),
        out,
        replace(usual.fit, seed=seed),
        evaluation_poses=evaluation_poses,
    )
    print_training(trained)
    if summary is not None:
        write_file(summary, json.dumps(calibration_summary(calibrated), indent=2) + "\n")


def calibration_summary(calibrated: "CalibratedRobot") -> dict[str, Any]:
    """The results of a calibration as plain data."""
    return {
        "robot": calibrated.dataset.robot.name,
        "seconds": calibrated.seconds,
        "candidates": [
            {**asdict(candidate), "parts": _names(candidate.parts)}
            for candidate in calibrated.candidates
        ],
        **calibrated.provenance,
    }


def _print_calibration(calibrated: "CalibratedRobot") -> None:
    """Print the parts of the model, the outliers, and the errors that were not identified."""
    table = Table("parts of the model", "parameters", "left-out error", "")
    for candidate in calibrated.candidates:
        table.add_row(
            ", ".join(_names(candidate.parts)),
            str(candidate.parameters),
            f"{candidate.score:.3g} ± {candidate.standard_error:.1g}",
            "used" if candidate.parts == calibrated.estimate.model.parts else "",
        )
    table.caption = "mean square, in squared standard deviations of the noise: 1 is noise alone"
    Console().print(table)
    noise, outliers = calibrated.estimate.noise, calibrated.outliers
    click.echo(
        f"{len(calibrated.dataset)} measured poses of {calibrated.dataset.robot.name}, "
        f"{int(outliers.sum())} outliers left out, {calibrated.seconds:.1f} s"
    )
    click.echo(
        f"unexplained: {1e3 * noise.position:.4f} mm and {np.degrees(noise.orientation):.5f} "
        "degrees in each coordinate"
    )
    if outliers.any():
        rows = ", ".join(map(str, np.flatnonzero(outliers)))
        click.echo(f"outliers, by their row in the dataset: {rows}")
    if calibrated.unidentified:
        names = "; ".join(calibrated.unidentified)
        click.echo(f"not identified by these poses, left near nominal: {names}")


def _names(parts: Iterable[Any]) -> list[str]:
    return sorted(part.value for part in parts)

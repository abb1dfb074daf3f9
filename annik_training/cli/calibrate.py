"""``annik calibrate``: from measured poses to the model file of a calibrated arm."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from click.core import ParameterSource
from rich.console import Console
from rich.table import Table

import annik_training
from annik_core.dataset import Dataset
from annik_core.files import ensure_writable_folder, expanded, read_regular_file, write_file
from annik_core.robots.calibrated_urdf import calibrated_urdf, left_out
from annik_core.robots.definition import LENGTH_UNITS
from annik_core.robots.robot import Robot
from annik_core.robots.urdf_text import MAX_LENGTH, decoded
from annik_training.calibration.measurement_files import (
    MeasuredRows,
    Units,
    read_measurements,
    read_sockets,
)
from annik_training.calibration.measurements import Measurements
from annik_training.calibration.validation import check_rows
from annik_training.cli.calibration_report import (
    by_joint,
    calibration_report,
    errors_by_row,
    findings,
    listed,
    warnings,
    write_calibration_report,
)
from annik_training.cli.options import (
    EVALUATION_POSES,
    FILE,
    SEED,
    SUMMARY,
    chosen_robot,
    measured_dataset,
    nominal_options,
)
from annik_training.cli.output import print_training
from annik_training.defaults import defaults_of

if TYPE_CHECKING:
    from annik_training import CalibratedRobot

_IN_FILE = "the file says it"
#: Options that don't apply to a source of the measurements, and why.
_NOT_FOR = {
    "measured": {
        "length_unit": _IN_FILE,
        "angle_unit": _IN_FILE,
        "frame_known": _IN_FILE,
        "tool_known": _IN_FILE,
        "socket_distance": "these are poses",
        "check": "give --out, and annik evaluate --measured",
    },
    "sockets": {
        "frame_known": "no instrument measured them",
        "position_only": "they have no orientation",
    },
}
#: The same of a dataset's own robot, and without a model file.
_OF_ROBOT = dict.fromkeys(("base_frame", "end_effector_frame", "joint_box"), "give --robot too")
_OF_MODEL = dict.fromkeys(("examples", "evaluation_poses"), "give --out too")


@click.command()
@click.option(
    "--measured", type=FILE, help="Poses measured by example_collector, a dataset (.npz)."
)
@click.option(
    "--measurements",
    type=FILE,
    multiple=True,
    help="A table (.csv) with a column for every joint, and x, y, z with or without an "
    "orientation, or socket; once for each file.",
)
@click.option(
    "--sockets",
    type=click.Path(file_okay=False, path_type=Path),
    multiple=True,
    help="Folder of placements, each with joint positions in hole_0.csv and hole_1.csv, recorded "
    "with a ball in the one and the other of two sockets; once for each folder.",
)
@click.option(
    "--socket-distance",
    type=click.FloatRange(0.0, min_open=True),
    help="Known distance between the two sockets of a placement [m].",
)
@click.option(
    "--check",
    type=click.Path(path_type=Path),
    multiple=True,
    help="Rows that are not used for the calibration, to check it: a table, or a folder with "
    "sockets; once for each.",
)
@click.option(
    "--length-unit",
    type=click.Choice([unit for unit in LENGTH_UNITS if unit]),
    default="m",
    show_default=True,
    help="Of the columns whose names have none.",
)
@click.option(
    "--angle-unit",
    type=click.Choice(["rad", "deg"]),
    default="rad",
    show_default=True,
    help="Of the columns whose names have none.",
)
@click.option(
    "--frame-known", is_flag=True, help="The measurements are in the robot's base frame."
)
@click.option(
    "--tool-known", is_flag=True, help="What was measured is the robot's end effector frame."
)
@nominal_options
@click.option(
    "--gravity",
    type=float,
    nargs=3,
    default=(0.0, 0.0, -1.0),
    show_default=True,
    help="Its direction in the base frame, for a robot on a wall (such as 1 0 0) or a ceiling "
    "(0 0 1).",
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
@click.option("--out", type=FILE, help="The model file to write (.onnx).")
@click.option(
    "--urdf-out",
    type=FILE,
    help="The URDF to write, with the geometric part of the calibration.",
)
@click.option(
    "--report",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for a page about the calibration, the error of every row, and the joint "
    "positions whose measurement would help most.",
)
@SUMMARY
def calibrate(
    measured: Path | None,
    position_only: bool,
    seed: int,
    examples: int,
    evaluation_poses: int,
    out: Path | None,
    urdf_out: Path | None,
    summary: Path | None,
    report: Path | None,
    gravity: tuple[float, float, float],
    **choices: Any,
) -> None:
    """Calibrate an arm from measurements, and write its model file, its URDF, or both.

    Corrects the geometry of the links, the joint zeros and the joints' transmissions, as far as
    the measurements identify them. A node with this model commands the corrected robot, and the
    residuals that it reports are those of the corrected robot.
    """
    if out is None and urdf_out is None:
        raise click.UsageError("give --out, --urdf-out, or both")
    if out is None:
        _refuse(_OF_MODEL, "--urdf-out alone")
    description = _description(choices["robot"])
    length = float(np.linalg.norm(gravity))
    if not 0.0 < length < math.inf:
        raise click.UsageError(f"--gravity {gravity} is no direction")
    options = annik_training.CalibrationOptions(
        position_only=position_only,
        seed=seed,
        gravity=(gravity[0] / length, gravity[1] / length, gravity[2] / length),
    )
    robot, measurements, places = _measured(measured, position_only, choices)
    checked = None
    if choices["check"]:
        folders = [path for path in choices["check"] if path.is_dir()]
        tables = [path for path in choices["check"] if path not in folders]
        if folders and tables:
            raise click.UsageError("give --check tables or folders with sockets, not both")
        checked = _read(robot, tables, folders, position_only, choices).measurements()
    if report is not None:
        ensure_writable_folder(report)
    for path in filter(None, (out, urdf_out, summary)):
        ensure_writable_folder(path.parent)
    calibrated = annik_training.calibrate(robot, measurements, options)
    _print_calibration(calibrated, places)
    if checked is not None:
        _print_check(calibrated, checked)
    if report is not None:
        write_calibration_report(calibration_report(calibrated, places), report)
        click.echo(f"wrote {report / 'report.html'}")
    if urdf_out is not None:
        rows = calibrated.estimate.observations.joint_positions
        write_file(urdf_out, calibrated_urdf(calibrated.robot, description, rows))
        rest = left_out(calibrated.robot, rows)
        click.echo(
            f"wrote {urdf_out}, the geometric part: {1e3 * rest.mean:.3g} mm from the calibrated "
            f"robot on average, {1e3 * rest.largest:.3g} mm at most, where it was measured"
        )
    if out is not None:
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


def _description(source: str | None) -> str | None:
    """The text of the URDF that was given, with what is off the chain; None if none was."""
    path = None if source is None else expanded(source)
    if path is None or path.suffix.lower() != ".urdf" or not path.is_file():
        return None
    return decoded(read_regular_file(path, MAX_LENGTH))


def _measured(
    measured: Path | None, position_only: bool, choices: dict[str, Any]
) -> tuple[Robot, Dataset | Measurements, list[str]]:
    """The nominal robot, what was measured on it, from one of the three sources, and its rows."""
    tables, folders = choices["measurements"], choices["sockets"]
    if sum(map(bool, (measured, tables, folders))) != 1:
        raise click.UsageError("give one of --measured, --measurements and --sockets")
    if measured is not None:
        _refuse(_NOT_FOR["measured"], "--measured")
        if choices["robot"] is None:
            _refuse(_OF_ROBOT, "--measured alone")
        dataset = measured_dataset(measured)
        robot = dataset.robot if choices["robot"] is None else chosen_robot(choices)
        return robot, dataset, [f"row {row}" for row in range(len(dataset))]
    if choices["robot"] is None:
        raise click.UsageError("give --robot: these files don't say which robot was measured")
    robot = chosen_robot(choices)
    rows = _read(robot, tables, folders, position_only, choices)
    if rows.sockets is not None:
        _refuse(_NOT_FOR["sockets"], "sockets")
    for note in rows.notes:
        click.echo(f"annik: {note}", err=True)
    measurements = rows.measurements(
        socket_distance=choices["socket_distance"],
        frame_known=choices["frame_known"],
        tool_known=choices["tool_known"],
    )
    return robot, measurements, [f"{path}, line {line}" for path, line in rows.places]


def _refuse(options: dict[str, str], source: str) -> None:
    """Refuse options that were given and would be ignored."""
    context = click.get_current_context()
    for name, remedy in options.items():
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{name.replace('_', '-')} is not for {source}: {remedy}")


def _read(
    robot: Robot,
    tables: Sequence[Path],
    folders: Sequence[Path],
    position_only: bool,
    choices: dict[str, Any],
) -> MeasuredRows:
    """The rows of folders with sockets, or of tables."""
    units = Units(choices["length_unit"], choices["angle_unit"])
    if folders:
        return read_sockets(robot, folders, units)
    return read_measurements(robot, tables, units, position_only=position_only)


def calibration_summary(calibrated: "CalibratedRobot") -> dict[str, Any]:
    """The results of a calibration as plain data."""
    return {
        "robot": calibrated.nominal.name,
        "seconds": calibrated.seconds,
        "candidates": [
            {**asdict(candidate), "parts": _names(candidate.parts)}
            for candidate in calibrated.candidates
        ],
        **calibrated.provenance,
    }


def _print_calibration(calibrated: "CalibratedRobot", places: Sequence[str]) -> None:
    """Print the parts of the model, errors, outliers, frames, and what was not identified."""
    table = Table("parts of the model", "parameters", "rows as one", "left-out error", "weight")
    for candidate in listed(calibrated.candidates):
        table.add_row(
            ", ".join(_names(candidate.parts)),
            str(candidate.parameters),
            f"{candidate.redundancy:g}",
            f"{candidate.score:.3g} ± {candidate.standard_error:.1g}",
            f"{candidate.weight:.2f}" if candidate.weight else "",
        )
    table.caption = "mean square of rows that a fit did not see; 1 is what most rows have at best"
    Console().print(table)
    outliers = calibrated.outliers
    rows = Table("position error [mm]".replace("[", "\\["), "mean", "median", "largest")
    for name, errors in zip(
        ("robot as described, frames fitted", "calibrated, each row left out"),
        errors_by_row(calibrated),
        strict=True,
    ):
        kept = 1e3 * errors[~outliers]
        rows.add_row(name, *(f"{of(kept):.4g}" for of in (np.mean, np.median, np.max)))
    Console().print(rows)
    what = "measured poses" if calibrated.estimate.observations.fixed_points is None else "rows"
    click.echo(
        f"{len(calibrated.measured)} {what} of {calibrated.nominal.name}, "
        f"{int(outliers.sum())} outliers left out, {calibrated.seconds:.1f} s"
    )
    for what, value in findings(calibrated):
        click.echo(f"{what}: {value}")
    for warning in warnings(calibrated, places):
        click.echo(f"annik: {warning}", err=True)
    if outliers.any():
        named = (places[row] for row in np.flatnonzero(outliers).tolist())
        click.echo(f"outliers: {'; '.join(named)}")
    if calibrated.unidentified:
        click.echo("not identified by these poses, left near nominal:")
        for joint, kinds in by_joint(calibrated.unidentified).items():
            click.echo(f"  {joint}: {'; '.join(kinds)}")


def _print_check(calibrated: "CalibratedRobot", measurements: Measurements) -> None:
    """Print the errors at rows that were not used."""
    found = check_rows(
        calibrated.robot,
        calibrated.frames,
        calibrated.measured.joint_positions,
        measurements,
    )
    errors = {"position": (1e3 * found.distances, 1e3 * found.bounds[:, 0], "mm")}
    if found.angles is not None:
        errors["orientation"] = (
            np.degrees(found.angles),
            np.degrees(found.bounds[:, 1]),
            "degrees",
        )
    for name, (values, bounds, unit) in errors.items():
        click.echo(
            f"{len(values)} other rows, {name} error: {values.mean():.4g} {unit} on average, "
            f"{values.max():.4g} {unit} at most; {100.0 * (values <= bounds).mean():.0f} % within "
            "the bound"
        )


def _names(parts: Iterable[Any]) -> list[str]:
    return sorted(part.value for part in parts)

"""The report of a calibration: a page, residuals by row, and what to measure next."""

import math
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure
from numpy.typing import NDArray

from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.calibration.estimation import residuals_of
from annik_training.calibration.observations import Observations
from annik_training.cli.plots import png
from annik_training.designs.identifiability_design import most_informative

if TYPE_CHECKING:
    from annik_training import CalibratedRobot

#: Joint positions to measure next, chosen from so many.
_FOLLOWING, _CANDIDATES = 10, 300
#: Parts of each joint's measured interval.
_REGIONS = 3
_COLUMNS = 4
_TEMPLATE = "calibration_report.html.jinja"


class Parameter(NamedTuple):
    """A parameter of the model, as it was estimated."""

    name: str
    amount: float  #: [rad] or [m]
    deviation: float  #: standard deviation
    is_angle: bool
    identified: bool

    @property
    def text(self) -> str:
        """Amount and standard deviation with their unit."""
        factor, unit = (180.0 / math.pi, "degrees") if self.is_angle else (1e3, "mm")
        return f"{factor * self.amount:.4f} ± {factor * self.deviation:.4f} {unit}"


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """What a report shows."""

    robot: Robot  #: the calibrated one
    joint_positions: FloatArray  #: ``(n, dof)`` of all rows
    #: ``(n,)`` error of the robot as described, with the frames fitted [m].
    before: FloatArray
    after: FloatArray  #: ``(n,)`` error of the calibrated robot where each row is left out [m]
    outliers: NDArray[np.bool_]  #: ``(n,)`` rows that were left out
    places: Sequence[str]  #: ``(n,)`` file and line of each row, or its number
    parameters: Sequence[Parameter]
    following: FloatArray  #: ``(m, dof)`` joint positions whose measurement would help most
    notes: Sequence[str] = ()

    def regions(self) -> Iterator[tuple[str, str, int, float, float]]:
        """Joint, part of its measured interval, rows, and mean error before and after [m]."""
        kept = ~self.outliers
        for joint, name in enumerate(self.robot.joint_names):
            values = self.joint_positions[:, joint]
            edges = np.linspace(values.min(), values.max(), _REGIONS + 1)
            parts = np.digitize(values, edges[1:-1])
            for part in range(_REGIONS):
                inside = kept & (parts == part)
                if inside.any():
                    yield (
                        name,
                        f"{edges[part]:.2f} to {edges[part + 1]:.2f}",
                        int(inside.sum()),
                        float(self.before[inside].mean()),
                        float(self.after[inside].mean()),
                    )


def errors_by_row(calibrated: "CalibratedRobot") -> tuple[FloatArray, FloatArray]:
    """Position errors ``(n,)`` [m] of all rows, before and after; see :class:`CalibrationReport`.

    In the frame of the instrument; of fixed points, the distances from where they are estimated.
    """
    found = calibrated.estimate
    whole = Observations.of(calibrated.measured, position_only=calibrated.options.position_only)
    whole = replace(whole, frames=found.observations.frames)
    described = np.zeros(len(found.parameters))
    before, after = (
        residuals_of(found.model, parameters, whole, found.noise)[:, :3]
        for parameters in (described, found.parameters)
    )
    after[~calibrated.outliers] = found.left_out_residuals[:, :3]
    noise = found.noise.position
    return noise * np.linalg.norm(before, axis=1), noise * np.linalg.norm(after, axis=1)


def calibration_report(
    calibrated: "CalibratedRobot", places: Sequence[str], notes: Sequence[str] = ()
) -> CalibrationReport:
    """The report of a calibration, whose rows were read from ``places``."""
    found = calibrated.estimate
    deviations = np.sqrt(np.diag(found.covariance)).tolist()
    parameters = [
        Parameter(
            error.name,
            found.model.amount(error, value),
            abs(found.model.amount(error, deviation)),
            error.is_rotation,
            error.name not in calibrated.unidentified,
        )
        for error, value, deviation in zip(
            found.model.errors, found.parameters.tolist(), deviations, strict=False
        )
    ]
    return CalibrationReport(
        calibrated.robot,
        calibrated.measured.joint_positions,
        *errors_by_row(calibrated),
        calibrated.outliers,
        places,
        parameters,
        _following(calibrated),
        notes,
    )


def _following(calibrated: "CalibratedRobot") -> FloatArray:
    """Joint positions in the joint box at which a measurement would tell most."""
    found = calibrated.estimate
    candidates = calibrated.robot.joint_box.sample(_CANDIDATES, np.random.default_rng(0))
    columns = found.model.evaluate(found.model_parameters, candidates).columns
    rows = columns[:, :3] / found.noise.position
    if found.observations.has_orientation:
        rows = np.concatenate([rows, columns[:, 3:] / found.noise.orientation], axis=1)
    size = found.model.size
    chosen = most_informative(rows, _FOLLOWING, found.covariance[:size, :size])
    return candidates[chosen]


def write_calibration_report(report: CalibrationReport, folder: Path) -> None:
    """Write report.html, residuals.csv and next_configurations.csv.

    Raises:
        NotWritable: if they can't be written; earlier ones are then kept.
    """
    names = list(report.robot.joint_names)
    following = [names, *([repr(value) for value in row] for row in report.following.tolist())]
    rows = zip(report.places, report.before, report.after, report.outliers, strict=True)
    residuals = [
        ["row", "before_mm", "after_mm", "outlier"],
        *(
            [place.replace(",", ";"), f"{1e3 * before:.6f}", f"{1e3 * after:.6f}", str(int(left))]
            for place, before, after, left in rows
        ),
    ]
    contents = {
        "report.html": _page(report).encode(),
        "residuals.csv": _csv(residuals),
        "next_configurations.csv": _csv(following),
    }
    ensure_writable_folder(folder)
    write_files_atomically(folder, contents)


def _csv(rows: Sequence[Sequence[str]]) -> bytes:
    return "".join(",".join(row) + "\n" for row in rows).encode()


def _page(report: CalibrationReport) -> str:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = files("annik_training.cli").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    kept = ~report.outliers
    worst = sorted(np.flatnonzero(report.outliers).tolist(), key=lambda row: -report.after[row])
    return environment.from_string(template).render(
        report=report,
        before=report.before[kept],
        after=report.after[kept],
        outliers=[(report.places[row], report.after[row]) for row in worst],
        picture=b64encode(_picture(report)).decode(),
    )


def _picture(report: CalibrationReport) -> bytes:
    """Errors of all rows against the position of each joint, before and after."""
    names = report.robot.joint_names
    lines = -(-len(names) // _COLUMNS)
    figure = Figure(figsize=(3.0 * _COLUMNS, 2.4 * lines), layout="constrained")
    axes = list(figure.subplots(lines, _COLUMNS, squeeze=False, sharey=True).flat)
    kept = ~report.outliers
    for joint, (axis, name) in enumerate(zip(axes, names, strict=False)):
        values = report.joint_positions[:, joint]
        axis.semilogy(values[kept], 1e3 * report.before[kept], ".", color="#999999", ms=3)
        axis.semilogy(values[kept], 1e3 * report.after[kept], ".", color="#0072B2", ms=3)
        axis.semilogy(values[~kept], 1e3 * report.after[~kept], "x", color="#D55E00", ms=5)
        unit = "m" if report.robot.joint_types[joint] == "prismatic" else "rad"
        axis.set_xlabel(f"{name} [{unit}]".replace("$", r"\$"), fontsize=8)
        axis.tick_params(labelsize=7)
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    axes[0].set_ylabel("error [mm]", fontsize=8)
    return png(figure)

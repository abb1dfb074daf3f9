"""The report of a calibration: a page, residuals by row, and what to measure next."""

import math
from base64 import b64encode
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_core.pose import FloatArray, roll_pitch_yaw
from annik_core.robots.arm_kinematics import gravity_moments
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_training.calibration.estimation import derivatives_of, residuals_of
from annik_training.calibration.observations import Observations
from annik_training.cli.plots import png
from annik_training.designs.identifiability_design import most_informative

if TYPE_CHECKING:
    from annik_training import CalibratedRobot
    from annik_training.calibration.combination import Candidate

#: Joint positions to measure next, chosen from so many.
_FOLLOWING, _CANDIDATES = 10, 300
#: Most steps of Newton from there to a socket, their length in a joint [rad or m], and how near to
#: the socket they must come [m].
_STEPS, _LARGEST_STEP, _AT_SOCKET = 40, 0.2, 1e-5
#: Parts of each joint's measured interval.
_REGIONS = 3
_COLUMNS = 4
#: Orders of a joint's series are shown if they are so strong, relative to the strongest of all.
_STRONG = 0.1
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


class JointCorrection(NamedTuple):
    """Largest corrections of a joint at the measured rows, besides that of its zero."""

    joint: str
    unit: str
    by_weight: float | None  #: [mrad]; None if the model has no deflection
    by_position: float | None  #: [mrad or mm]; None if the model has no series
    orders: str  #: the strongest of its series, in periods a turn


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
    #: ``(m,)`` file of the socket that the ball is in there; empty without sockets.
    sockets: Sequence[str] = ()
    findings: Sequence[tuple[str, str]] = ()  #: what was found, and its value
    notes: Sequence[str] = ()  #: what to look at first
    candidates: "Sequence[Candidate]" = ()
    corrections: Sequence[JointCorrection] = ()

    @property
    def unidentified(self) -> dict[str, list[str]]:
        """What is not identified, by joint."""
        return by_joint(one.name for one in self.parameters if not one.identified)

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


def findings(calibrated: "CalibratedRobot") -> Iterator[tuple[str, str]]:
    """What was found, besides the parameters of the model, and its value."""
    found, frames, bound = calibrated.estimate, calibrated.frames, calibrated.robot.error_bound
    noise, observations = found.noise, found.observations
    angle = f" and {math.degrees(noise.orientation):.5f} degrees"
    yield (
        "unexplained",
        f"{1e3 * noise.position:.4f} mm{angle * observations.has_orientation} in each coordinate",
    )
    assert bound is not None
    bounds = bound.of_rows(calibrated.robot.in_box(observations.joint_positions))
    for index, (factor, unit) in enumerate(((1e3, "mm"), (180.0 / math.pi, "degrees"))):
        if index == 0 or observations.has_orientation:
            mean, largest = factor * bounds[:, index].mean(), factor * bounds[:, index].max()
            yield (
                ("position", "orientation")[index] + " error of 95 of 100 poses",
                f"at most {mean:.4g} {unit} on average, {largest:.4g} {unit} somewhere",
            )
    motion = found.model.corrections(found.model_parameters).pose_harmonics
    if motion is not None:
        shifts = np.linalg.norm(motion.motions(observations.joint_positions)[:, :3], axis=1)
        yield (
            "motion of the end effector that no joint explains",
            f"{1e3 * shifts.mean():.3g} mm on average, {1e3 * shifts.max():.3g} mm at most",
        )
    repeated = calibrated.repeatability
    if repeated is not None:
        cause = ": play or friction, which the bound includes" if repeated.is_play else ""
        yield (
            f"repeated approaches ({repeated.pairs})",
            f"end {1e3 * repeated.distance:.3f} mm from their mean{cause}",
        )
    if frames.base_unknown:
        yield "robot's base in the frame of the measurements", _shown(frames.base)
    if frames.tool_unknowns:
        position, _, angles = _shown(frames.tool).partition("; ")
        tool = position if frames.tool_unknowns == 3 else f"{position}; {angles}"
        yield "what was measured, in the end effector frame", tool
    if calibrated.distances:
        alone = ", ".join(
            f"{1e3 * one.found:.2f} ± {1e3 * one.deviation:.2f}" for one in calibrated.distances
        )
        yield (
            "distance of the sockets",
            f"given {1e3 * calibrated.distances[0].known:.2f} mm; by the arm alone {alone} mm",
        )


def warnings(calibrated: "CalibratedRobot", places: Sequence[str] = ()) -> Iterator[str]:
    """What to look at before the calibration is used; ``places`` are those of its rows."""
    used_distances = calibrated.estimate.observations.distances
    for one in calibrated.distances:
        is_used = any(one[:2] == used[:2] for used in used_distances)
        if is_used and not one.is_doubtful:
            continue
        first, second = _files(calibrated, places, one[:2]) if places else map(str, one[:2])
        if not (is_used or one.is_another):
            yield (
                f"the distance of the sockets {first} and {second} is not used: one of them was "
                "touched fewer than three times"
            )
            continue
        yield (
            f"by the arm, the sockets {first} and {second} are {1e3 * one.found:.2f} ± "
            f"{1e3 * one.deviation:.2f} mm apart, not {1e3 * one.known:.2f}"
            f"{': this distance is not used' * one.is_another}; check --socket-distance, which "
            "file is which socket, and whether their base was moved"
        )
    if calibrated.repeatability is not None and calibrated.repeatability.is_play:
        yield (
            f"the arm has play or friction of {1e3 * calibrated.repeatability.distance:.2f} mm, "
            "which no calibration corrects"
        )
    if calibrated.stated_noise is not None:
        yield (
            "the measurements are stated to have a noise of "
            f"{1e3 * calibrated.stated_noise.position:.4g} mm and "
            f"{math.degrees(calibrated.stated_noise.orientation):.4g} degrees, but they agree "
            "much better: it is not used"
        )


def _shown(frame: FloatArray) -> str:
    quaternion = Rotation.from_matrix(frame[:3, :3]).as_quat(canonical=True)
    position = ", ".join(f"{1e3 * part:.3f}" for part in frame[:3, 3])
    angles = ", ".join(f"{np.degrees(part):.4f}" for part in roll_pitch_yaw(quaternion.tolist()))
    return f"{position} mm; roll, pitch, yaw {angles} degrees"


def joint_corrections(calibrated: "CalibratedRobot") -> Iterator[JointCorrection]:
    """Those of every joint, if the model has any."""
    found, robot = calibrated.estimate, calibrated.nominal
    joint_positions = found.observations.joint_positions
    corrections = found.model.corrections(found.model_parameters)
    deflection, series = corrections.deflection, corrections.joint_harmonics
    by_weight = by_position = amplitudes = None
    if deflection is not None:
        chain = ScrewChain.from_urdf(robot.definition["urdf"])
        moments = gravity_moments(chain, joint_positions, deflection.gravity)
        by_weight = np.abs((moments * deflection.compliances).sum(-1)).max(axis=0)
    if series is not None:
        by_position = np.abs(series.actual(joint_positions) - joint_positions).max(axis=0)
        amplitudes = np.hypot(series.sines, series.cosines)
    if deflection is None and series is None:
        return
    for joint, name in enumerate(robot.joint_names):
        orders = ""
        if amplitudes is not None:
            strongest = np.argsort(-amplitudes[joint])[:3]
            strongest = strongest[amplitudes[joint, strongest] > _STRONG * amplitudes.max()]
            orders = ", ".join(str(order + 1) for order in sorted(strongest.tolist()))
        yield JointCorrection(
            name,
            "mm" if robot.joint_types[joint] == "prismatic" else "mrad",
            None if by_weight is None else 1e3 * float(by_weight[joint]),
            None if by_position is None else 1e3 * float(by_position[joint]),
            orders,
        )


def calibration_report(calibrated: "CalibratedRobot", places: Sequence[str]) -> CalibrationReport:
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
        *_following(calibrated, places),
        tuple(findings(calibrated)),
        tuple(warnings(calibrated, places)),
        tuple(listed(calibrated.candidates)),
        tuple(joint_corrections(calibrated)),
    )


def listed(candidates: Sequence["Candidate"]) -> "Iterator[Candidate]":
    """Those that are used, and one of each set of parts."""
    least = min(one.redundancy for one in candidates)
    return (one for one in candidates if one.weight or one.redundancy == least)


def by_joint(names: Iterable[str]) -> dict[str, list[str]]:
    """Names of errors, such as "elbow_joint: zero", by what is before the colon."""
    grouped: defaultdict[str, list[str]] = defaultdict(list)
    for name in names:
        joint, _, kind = name.partition(": ")
        grouped[joint].append(kind)
    return dict(grouped)


def _following(
    calibrated: "CalibratedRobot", places: Sequence[str]
) -> tuple[FloatArray, list[str]]:
    """Joint positions in the joint box at which a measurement would tell most; see the report."""
    found = calibrated.estimate
    candidates = calibrated.robot.joint_box.sample(_CANDIDATES, np.random.default_rng(0))
    points = found.observations.fixed_points
    if points is not None:
        numbers = np.arange(_CANDIDATES) % (points.max() + 1)
        candidates, there = _at_points(calibrated, candidates, numbers)
        candidates, points = candidates[there], numbers[there]
    measured = found.observations.elsewhere(candidates, points)
    rows = derivatives_of(found.model, found.parameters, measured, found.noise)
    chosen = most_informative(rows, min(_FOLLOWING, len(candidates)), found.covariance)
    if points is None:
        return candidates[chosen], []
    return candidates[chosen], _files(calibrated, places, points[chosen])


def _files(
    calibrated: "CalibratedRobot", places: Sequence[str], points: Iterable[int]
) -> list[str]:
    """Where the rows at fixed points are: the file of each, or its first line in one for all."""
    touched = Observations.of(calibrated.measured).fixed_points
    assert touched is not None
    lines = [places[int(np.flatnonzero(touched == point)[0])] for point in points]
    files = [line.rpartition(", line")[0] for line in lines]
    return lines if len(set(files)) < len(set(lines)) else files


def _at_points(
    calibrated: "CalibratedRobot", joint_positions: FloatArray, numbers: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """From ``(n, dof)`` to where the ball is at the fixed points ``(n,)``, and whether it is."""
    robot, frames = calibrated.robot, calibrated.frames
    kinematics, box = robot.forward_kinematics, robot.joint_box
    for step in range(_STEPS + 1):
        poses = kinematics.poses(joint_positions)
        lever = Rotation.from_quat(poses[:, 3:]).apply(frames.tool[:3, 3])
        away = frames.points[numbers] - poses[:, :3] - lever
        if step == _STEPS:
            break
        jacobians = kinematics.jacobians(joint_positions)
        linear = jacobians[:, :3] + np.cross(jacobians[:, 3:], lever[..., np.newaxis], axis=1)
        steps = (np.linalg.pinv(linear) @ away[..., np.newaxis])[..., 0]
        moved = joint_positions + np.clip(steps, -_LARGEST_STEP, _LARGEST_STEP)
        joint_positions = np.clip(moved, box.lower, box.upper)
    return joint_positions, np.linalg.norm(away, axis=1) < _AT_SOCKET


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

"""Kinematic calibration of an arm from measurements: fits with other parts, and their result."""

import math
import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.errors import InvalidValue
from annik_core.pose import FloatArray
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.kinematic_errors import motion_poses
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain, motion_matrices
from annik_core.settings import check_settings, setting
from annik_training.calibration.combination import Candidate, combined
from annik_training.calibration.distances import FoundDistance, found_distances
from annik_training.calibration.errors import InvalidMeasurements, TooFewMeasurements
from annik_training.calibration.estimation import Estimate, tuned
from annik_training.calibration.frames import OTHER, Frames, check_known, initial_frames
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import ParametricModel, Part, check_nominal_arm
from annik_training.calibration.noise_tails import noise_degrees
from annik_training.calibration.observations import Noise, Observations, check_measured_alike
from annik_training.calibration.outliers import find_outliers
from annik_training.calibration.repeatability import Repeatability, repeatability
from annik_training.calibration.uncertainty import (
    check_explained,
    check_moved,
    check_size,
    error_bound_of,
    unidentified_parameters,
)
from annik_training.fitting.levenberg_marquardt import one_thread

#: Sets of parts of the model to choose from, the simplest first.
CANDIDATES: tuple[frozenset[Part], ...] = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.DEFLECTION}),
    frozenset({Part.GEOMETRY, Part.JOINT_SERIES}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_SERIES}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.DEFLECTION, Part.JOINT_SERIES}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.DEFLECTION, Part.POSE_SERIES}),
)
#: Where the estimate of the noise begins: that of the nominal robot.
_FIRST_NOISE = Noise(1e-3, 1e-3)
#: A stated noise is at most so many times the residuals: more is another unit, or another noise.
_CREDIBLE = 1.5
#: Fits without series and networks are also made as if so many rows told as much as one.
_REDUNDANCIES = (2.0, 4.0, 8.0)
#: The same of fixed points at one placement: what its rows have in common, none of them tells.
_REDUNDANCY_OF_A_PLACE = 2.0
#: Without a measured length rows tell no more than so many: a smaller arm has smaller residuals,
#: and the more they count, the more it shrinks.
_ROWS_WITHOUT_LENGTH = 100
#: Of a fixed point that was touched less often the place is too uncertain for a distance.
_LEAST_TOUCHED = 3


@dataclass(frozen=True)
class CalibrationOptions:
    """Options of a calibration.

    Raises:
        InvalidValue: naming the option and what is allowed.
    """

    position_only: bool = setting(False, "Ignore the orientations: they were not measured.")
    seed: int = setting(
        0, "Seed of the initial networks and of the error bound.", within=(0, None)
    )
    #: Sets of parts of the model to choose from, the simplest first.
    candidates: tuple[frozenset[Part], ...] = CANDIDATES
    restarts: int = setting(
        2, "Number of fits from random initial networks; the best is used.", within=(1, 100)
    )
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)  #: direction in the base frame
    max_evaluations: int = setting(
        100, "Most evaluations of the residuals in one fit.", within=(1, 100_000)
    )

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        check_settings(self)
        if not self.candidates or not all(Part.GEOMETRY in parts for parts in self.candidates):
            allowed = "one set of parts or more, each with the geometry"
            raise InvalidValue("candidates", self.candidates, allowed)
        if not abs(float(np.linalg.norm(self.gravity)) - 1.0) < 1e-6:
            raise InvalidValue("gravity", self.gravity, "a unit vector in the base frame")


@dataclass(frozen=True, eq=False)
class CalibratedRobot:
    """A robot calibrated with measured poses."""

    robot: Robot  #: the nominal robot with corrections; its definition carries them
    nominal: Robot
    measured: Dataset | Measurements
    frames: Frames  #: base, tool and fixed points, as far as they were unknown
    estimate: Estimate  #: the parameters of the model, and how well they are known
    candidates: tuple[Candidate, ...]  #: the fits that were compared; ``estimate`` is their mean
    outliers: NDArray[np.bool_]  #: ``(n,)`` the examples that were left out
    #: Known distances between fixed points, beside those that the arm itself tells.
    distances: tuple[FoundDistance, ...]
    #: Geometric errors that the poses don't identify; they stay near nominal.
    unidentified: tuple[str, ...]
    repeatability: Repeatability | None  #: None without repeated approaches
    stated_noise: Noise | None  #: of the measurements, if the residuals are far too small for it
    options: CalibrationOptions
    seconds: float

    @property
    def dataset(self) -> Dataset:
        """The measured poses, with the nominal robot.

        Raises:
            InvalidMeasurements: if what was measured is no dataset.
        """
        if not isinstance(self.measured, Dataset):
            raise InvalidMeasurements("dataset", "what was measured is none")
        return self.measured

    @property
    def provenance(self) -> dict[str, Any]:
        """How the robot was calibrated, as plain data; its definition carries this too."""
        return dict(self.robot.definition["corrections"]["provenance"])


@one_thread()
def calibrate(
    robot: Robot,
    measured: Dataset | Measurements,
    options: CalibrationOptions | None = None,
) -> CalibratedRobot:
    """Calibrate a nominal arm with what was measured on it.

    Joint positions are as commanded. A dataset has poses of the end effector frame in the base
    frame; of measurements, the frames may be unknown.

    Raises:
        UnsupportedRobot: if the robot is no nominal arm.
        RobotMismatch: if the poses were measured with other joints or frames.
        InvalidMeasurements: if they are of another number of joints.
        TooFewMeasurements: naming the least number.
        OtherDistance: if a known distance between fixed points is not that of the arm.
        OtherFrame: if a frame that is said to be known is another one.
        UnexplainedMeasurements: if the poses are not this robot's.
        ImplausibleErrors: if they are another robot's.
        DegenerateExamples: naming the joints to move.
        NonFiniteValue: if a number is not finite.
    """
    begin = time.perf_counter()
    options = options or CalibrationOptions()
    check_nominal_arm(robot)
    if isinstance(measured, Dataset):
        check_measured_alike(robot, measured.robot)
        measured = replace(measured, robot=robot)
        sigma = measured.measurement_noise
        provenance = {
            "dataset_hash": measured.content_hash,
            "measurements_hash": measured.measurements_hash,
        }
    else:
        if measured.joint_positions.shape[1] != robot.dof:
            raise InvalidMeasurements(
                "joint_positions",
                f"{measured.joint_positions.shape[1]} columns, but {robot.name} has "
                f"{robot.dof} joints",
            )
        sigma = measured.sigma
        provenance = {"measurements_hash": measured.content_hash}
    observations = Observations.of(measured, position_only=options.position_only)
    rng = np.random.default_rng(options.seed)
    simplest = ParametricModel(robot, options.candidates[0])
    _check_number(simplest, observations, 0)
    observations = replace(observations, frames=_frames(robot, measured, observations))
    check_moved(robot, observations, _FIRST_NOISE, rng)
    found, candidates, outliers, distances = _estimate(robot, observations, options, rng)
    check_explained(found, rng)
    frames = found.observations.frames.moved(found.unknowns)
    corrections = found.model.corrections(found.model_parameters)
    if isinstance(measured, Dataset) and found.observations.frames.tool_unknowns:
        corrections = _with_tool(robot, corrections, frames.tool)
    unidentified = unidentified_parameters(found)
    noise = credible_noise(found, sigma)
    repeated = repeatability(found, noise)
    corrections = replace(
        corrections,
        # What the measurements' own spread does not say is the robot's.
        error_bound=error_bound_of(found, noise, np.random.default_rng(options.seed)),
        provenance={
            "examples": len(measured),
            "outliers": np.flatnonzero(outliers).tolist(),
            **provenance,
            "position_only": not observations.has_orientation,
            "parts": sorted(part.value for part in found.model.parts),
            "position_noise": found.noise.position,
            "orientation_noise": found.noise.orientation,
            "noise_degrees": found.observations.noise_degrees,
            "unidentified": list(unidentified),
            "play": repeated.distance if repeated is not None and repeated.is_play else 0.0,
            "seed": options.seed,
        },
    )
    definition = {**robot.definition, "corrections": corrections.to_dict()}
    return CalibratedRobot(
        robot_from_definition(definition, f"calibrated {robot.name}"),
        robot,
        measured,
        frames,
        found,
        candidates,
        outliers,
        distances,
        unidentified,
        repeated,
        None if sigma is None or astuple(noise) == tuple(sigma) else Noise(*sigma),
        options,
        time.perf_counter() - begin,
    )


def _frames(robot: Robot, measured: Dataset | Measurements, observations: Observations) -> Frames:
    """Where the fit begins; of a dataset the tool is unknown only if it is another one."""
    joint_positions = observations.joint_positions
    poses = robot.forward_kinematics.poses(joint_positions)
    where = poses[:, :3], Rotation.from_quat(poses[:, 3:]).as_matrix()
    rotations = observations.rotations if observations.has_orientation else None
    if isinstance(measured, Dataset):
        positions = observations.positions
        measurements = Measurements(joint_positions, positions, rotations, frame_known=True)
    else:
        measurements = replace(measured, rotations=rotations)
    frames = initial_frames(measurements, *where)
    check_known(measurements, frames, *where)
    if not isinstance(measured, Dataset):
        return frames
    shift = float(np.linalg.norm(frames.tool[:3, 3]))
    turn = float(Rotation.from_matrix(frames.tool[:3, :3]).magnitude())
    return frames if shift > OTHER[0] or turn > OTHER[1] else Frames.known()


def _with_tool(robot: Robot, corrections: ArmCorrections, tool: FloatArray) -> ArmCorrections:
    """Corrections whose end effector is a tool ``(4, 4)`` in the end effector frame."""
    end = ScrewChain.from_urdf(robot.definition["urdf"]).placements[-1]
    placements = corrections.placements.copy()
    last = motion_matrices(placements[-1:]) @ end @ tool @ np.linalg.inv(end)
    placements[-1] = motion_poses(last)[0]
    harmonics, network = corrections.pose_harmonics, corrections.pose_network
    # Motions of the end effector come before the tool: the same twists, in the tool's frame.
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = tool[:3, :3].T
    turn[:3, 3:] = tool[:3, :3].T @ np.cross(np.eye(3), tool[:3, 3]).T
    if harmonics is not None:
        harmonics = replace(
            harmonics, cosines=turn @ harmonics.cosines, sines=turn @ harmonics.sines
        )
    if network is not None:
        network = replace(network, output_weights=turn @ network.output_weights)
    return replace(
        corrections, placements=placements, pose_harmonics=harmonics, pose_network=network
    )


def _estimate(
    robot: Robot,
    observations: Observations,
    options: CalibrationOptions,
    rng: np.random.Generator,
) -> tuple[Estimate, tuple[Candidate, ...], NDArray[np.bool_], tuple[FoundDistance, ...]]:
    models = [ParametricModel(robot, parts, options.gravity) for parts in options.candidates]
    # One that says too much of any pose finds no outlier.
    vague = {Part.POSE_SERIES, Part.JOINT_NETWORKS, Part.POSE_NETWORK}
    linear = [ParametricModel(robot, model.parts - vague, options.gravity) for model in models]
    # Without the known distances, which could be wrong too.
    outliers, fitted = find_outliers(
        max(linear, key=lambda model: model.size),
        _with_redundancy(replace(observations, distances=())),
        _FIRST_NOISE,
    )
    if observations.fixed_points is not None:
        check_size(fitted)
    distances = found_distances(fitted, observations) if observations.distances else ()
    kept = observations.where(~outliers)
    kept = _with_redundancy(replace(kept, distances=tuple(_credible(kept, distances))))
    _check_number(models[0], kept, int(outliers.sum()))
    degrees = noise_degrees(fitted.surprise[~outliers], kept.rows, kept.redundancy)
    kept = replace(kept, noise_degrees=degrees)
    fits = [_best_estimate(model, kept, options, rng) for model in models]
    if not any(model.has_networks for model in models):
        fits += [
            _best_estimate(model, replace(kept, redundancy=factor * kept.redundancy), options, rng)
            for model in models
            if not {Part.JOINT_SERIES, Part.POSE_SERIES} & model.parts
            for factor in _REDUNDANCIES
        ]
    found, candidates = combined(fits)
    return found, candidates, outliers, distances


def _credible(kept: Observations, distances: tuple[FoundDistance, ...]) -> Iterator[KnownDistance]:
    """Known distances that are used: as the arm tells, and between points that were touched."""
    for known, found in zip(kept.distances, distances, strict=True):
        touched = [np.count_nonzero(kept.fixed_points == point) for point in known[:2]]
        if not found.is_another and min(touched) >= _LEAST_TOUCHED:
            yield known


def _with_redundancy(observations: Observations) -> Observations:
    """The same, with how many rows tell as much as one before any fit."""
    redundancy = 1.0
    if not observations.has_length:
        redundancy = max(1.0, len(observations) / _ROWS_WITHOUT_LENGTH)
    placements = observations.placements
    if placements is not None and not placements.any():
        redundancy = max(redundancy, _REDUNDANCY_OF_A_PLACE)
    return replace(observations, redundancy=redundancy)


def _check_number(simplest: ParametricModel, observations: Observations, outliers: int) -> None:
    least = math.ceil(2 * simplest.size / observations.rows)
    if len(observations) < least:
        raise TooFewMeasurements(len(observations), least, outliers)


def _best_estimate(
    model: ParametricModel,
    observations: Observations,
    options: CalibrationOptions,
    rng: np.random.Generator,
) -> Estimate:
    """The best of the restarts, of which a model without networks needs one."""
    restarts = options.restarts if model.has_networks else 1
    fits = [
        tuned(model, observations, _FIRST_NOISE, model.start(rng), options.max_evaluations)
        for _ in range(restarts)
    ]
    return min(fits, key=lambda found: found.noise.position)


def credible_noise(found: Estimate, stated: tuple[float, float] | None) -> Noise:
    """The stated noise of the measurements; zero, not known, where their residuals are smaller."""
    measured = found.observations.rows // 3
    left = astuple(found.noise_by(np.ones(len(found.observations))))
    pairs = zip(left, stated or (0.0, 0.0), strict=True)
    credible = (
        own if own <= _CREDIBLE * noise or kind >= measured else 0.0
        for kind, (noise, own) in enumerate(pairs)
    )
    return Noise(*credible)

"""Kinematic calibration of an arm from measured poses: choice of the model's parts, and result."""

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.dataset import Dataset
from annik_core.errors import InvalidValue
from annik_core.pose import FloatArray
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.settings import check_settings, setting
from annik_training.calibration.errors import TooFewMeasurements
from annik_training.calibration.estimation import Estimate, estimate
from annik_training.calibration.model import ParametricModel, Part, check_nominal_arm
from annik_training.calibration.observations import Noise, Observations, check_measured_alike
from annik_training.calibration.outliers import find_outliers
from annik_training.calibration.uncertainty import (
    check_examples,
    error_bound_of,
    unidentified_parameters,
)
from annik_training.fitting.levenberg_marquardt import one_thread

#: Sets of parts of the model to choose from, the simplest first.
CANDIDATES: tuple[frozenset[Part], ...] = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT}),
    frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_NETWORKS}),
    frozenset(Part),
)
#: First noise if the dataset states none [m], [rad].
_UNKNOWN_NOISE = Noise(5e-5, 5e-5)
#: A gain of more than this many standard errors needs no cross-validation.
_CLOSE = 4.0
#: Number of times the noise is estimated anew.
_NOISE_ROUNDS = 3
_FOLDS = 5


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
    max_evaluations: int = setting(
        100, "Most evaluations of the residuals in one fit.", within=(1, 100_000)
    )

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        check_settings(self)
        if not self.candidates or not all(Part.GEOMETRY in parts for parts in self.candidates):
            allowed = "one set of parts or more, each with the geometry"
            raise InvalidValue("candidates", self.candidates, allowed)


@dataclass(frozen=True)
class Candidate:
    """How well a model with some of the parts predicts poses that it was not fitted to."""

    parts: frozenset[Part]
    parameters: int
    #: Mean square of the leave-one-out residuals, in squared standard deviations of the noise: 1
    #: is noise alone.
    score: float
    standard_error: float  #: of the score


@dataclass(frozen=True, eq=False)
class CalibratedRobot:
    """A robot calibrated with measured poses."""

    robot: Robot  #: the nominal robot with corrections; its definition carries them
    dataset: Dataset  #: the measured poses, with the nominal robot
    estimate: Estimate  #: the parameters of the model, and how well they are known
    #: The models that were compared; ``estimate.model.parts`` was chosen.
    candidates: tuple[Candidate, ...]
    outliers: NDArray[np.bool_]  #: ``(n,)`` the examples that were left out
    #: Geometric errors that the poses don't identify; they stay near nominal.
    unidentified: tuple[str, ...]
    options: CalibrationOptions
    seconds: float

    @property
    def provenance(self) -> dict[str, Any]:
        """How the robot was calibrated, as plain data; its definition carries this too."""
        return dict(self.robot.definition["corrections"]["provenance"])


def calibrate(
    robot: Robot, dataset: Dataset, options: CalibrationOptions | None = None
) -> CalibratedRobot:
    """Calibrate a nominal arm with measured poses.

    The dataset has joint positions as commanded, and poses of the end effector frame in the base
    frame.

    Raises:
        UnsupportedRobot: if the robot is no nominal arm.
        RobotMismatch: if the poses were measured with other joints or frames.
        TooFewMeasurements: naming the least number.
        UnexplainedMeasurements: if the poses are not this robot's.
        ImplausibleErrors: if they are another robot's.
        DegenerateExamples: naming the joints to move.
        NonFiniteValue: if a number is not finite.
    """
    begin = time.perf_counter()
    options = options or CalibrationOptions()
    check_nominal_arm(robot)
    check_measured_alike(robot, dataset.robot)
    dataset = replace(dataset, robot=robot)
    observations = Observations.of(dataset, position_only=options.position_only)
    with one_thread():
        found, candidates, outliers = _estimate(dataset, observations, options)
    unidentified = unidentified_parameters(found)
    # What the measurements' own spread says, or else all that the model leaves unexplained.
    noise = dataset.measurement_noise
    corrections = replace(
        found.model.corrections(found.parameters),
        error_bound=error_bound_of(
            found,
            found.noise if noise is None else Noise(*noise),
            np.random.default_rng(options.seed),
        ),
        provenance={
            "examples": len(dataset),
            "outliers": np.flatnonzero(outliers).tolist(),
            "dataset_hash": dataset.content_hash,
            "measurements_hash": dataset.measurements_hash,
            "position_only": options.position_only,
            "parts": sorted(part.value for part in found.model.parts),
            "position_noise": found.noise.position,
            "orientation_noise": found.noise.orientation,
            "unidentified": list(unidentified),
            "seed": options.seed,
        },
    )
    definition = {**robot.definition, "corrections": corrections.to_dict()}
    return CalibratedRobot(
        robot_from_definition(definition, f"calibrated {robot.name}"),
        dataset,
        found,
        candidates,
        outliers,
        unidentified,
        options,
        time.perf_counter() - begin,
    )


def predicts_better(
    flexible: ParametricModel,
    simple: ParametricModel,
    observations: Observations,
    noise: Noise,
    rng: np.random.Generator,
) -> bool:
    """Whether the flexible model's held-out errors are smaller by more than a standard error.

    The closed form for leaving one example out takes the networks for linear, and so flatters
    flexible models. This cross-validation fits both to parts of the examples instead; ``rng``
    draws the parts and the initial networks.
    """
    fold = rng.permutation(len(observations)) % _FOLDS
    gains = np.subtract(
        *(_held_out_squares(model, observations, noise, fold, rng) for model in (simple, flexible))
    )
    return bool(gains.mean() > gains.std(ddof=1) / math.sqrt(len(gains)))


def _held_out_squares(
    model: ParametricModel,
    observations: Observations,
    noise: Noise,
    fold: NDArray[np.int64],
    rng: np.random.Generator,
) -> FloatArray:
    """``(n,)`` squared residuals of each example by the fit without its fold."""
    squares = np.empty(len(observations))
    for number in range(_FOLDS):
        held_out = observations.where(fold == number)
        rest = observations.where(fold != number)
        found = estimate(model, rest, noise, model.start(rng))
        where = model.positions_and_rotations(found.parameters, held_out.joint_positions)
        squares[fold == number] = (held_out.residuals(*where, noise) ** 2).sum(axis=1)
    return squares


def _estimate(
    dataset: Dataset, observations: Observations, options: CalibrationOptions
) -> tuple[Estimate, tuple[Candidate, ...], NDArray[np.bool_]]:
    rng = np.random.default_rng(options.seed)
    robot = dataset.robot
    simplest = ParametricModel(robot, options.candidates[0])
    _check_number(simplest, observations, 0)
    noise = _UNKNOWN_NOISE
    if dataset.measurement_noise is not None:
        noise = _at_least(Noise(*dataset.measurement_noise))
    outliers = find_outliers(robot, observations, noise, rng)
    kept = observations.where(~outliers)
    _check_number(simplest, kept, int(outliers.sum()))
    fits = [
        _best_estimate(ParametricModel(robot, parts), kept, noise, options, rng)
        for parts in options.candidates
    ]
    candidates = tuple(_judged(found) for found in fits)
    found = fits[_confirmed(robot, _chosen(candidates), candidates, kept, noise, rng)]
    for _ in range(_NOISE_ROUNDS):
        noise = estimated_noise(found, dataset.measurement_noise)
        found = estimate(found.model, kept, noise, found.parameters, options.max_evaluations)
    check_examples(found, rng)
    return found, candidates, outliers


def _check_number(simplest: ParametricModel, observations: Observations, outliers: int) -> None:
    least = math.ceil(2 * simplest.size / observations.rows)
    if len(observations) < least:
        raise TooFewMeasurements(len(observations), least, outliers)


def _at_least(noise: Noise) -> Noise:
    """Noise that residuals can be divided by: an ideal robot's measurements have none."""
    return Noise(max(noise.position, 1e-7), max(noise.orientation, 1e-7))


def _best_estimate(
    model: ParametricModel,
    observations: Observations,
    noise: Noise,
    options: CalibrationOptions,
    rng: np.random.Generator,
) -> Estimate:
    """The best of the restarts, of which a model without networks needs one."""
    restarts = options.restarts if Part.JOINT_NETWORKS in model.parts else 1
    fits = [
        estimate(model, observations, noise, model.start(rng), options.max_evaluations)
        for _ in range(restarts)
    ]
    return min(fits, key=lambda found: found.cost)


def _judged(found: Estimate) -> Candidate:
    squares = (found.left_out_residuals**2).mean(axis=1)
    error = float(squares.std(ddof=1)) / math.sqrt(len(squares))
    return Candidate(found.model.parts, found.model.size, float(squares.mean()), error)


def _chosen(candidates: tuple[Candidate, ...]) -> int:
    """The simplest candidate within one standard error of the best."""
    best = min(candidates, key=lambda candidate: candidate.score)
    return next(
        index
        for index, candidate in enumerate(candidates)
        if candidate.score <= best.score + best.standard_error
    )


def _confirmed(
    robot: Robot,
    chosen: int,
    candidates: tuple[Candidate, ...],
    observations: Observations,
    noise: Noise,
    rng: np.random.Generator,
) -> int:
    """The choice; or, if it was close and fails cross-validation, the best simpler candidate."""
    if chosen == 0:
        return chosen
    simpler = min(range(chosen), key=lambda index: candidates[index].score)
    gain = candidates[simpler].score - candidates[chosen].score
    if gain > _CLOSE * candidates[simpler].standard_error:
        return chosen
    flexible, simple = (
        ParametricModel(robot, candidates[index].parts) for index in (chosen, simpler)
    )
    return chosen if predicts_better(flexible, simple, observations, noise, rng) else simpler


def estimated_noise(found: Estimate, known: tuple[float, float] | None) -> Noise:
    """Noise by the residuals of a fit and its degrees of freedom.

    The known spread of the measurements [m], [rad] is a lower bound.
    """
    squares, leverages = found.residuals**2, found.leverages
    taken = np.einsum("nrr->r", leverages)
    factors = []
    for rows in (slice(0, 3), slice(3, 6)):
        left = squares[:, rows].size - float(taken[rows].sum())
        total = float(squares[:, rows].sum())
        factors.append(math.sqrt(total / left) if left > 0.0 else 1.0)
    noise = Noise(found.noise.position * factors[0], found.noise.orientation * factors[1])
    if known is not None:
        noise = Noise(max(noise.position, known[0]), max(noise.orientation, known[1]))
    return _at_least(noise)

"""Kinematic calibration of an arm from measured poses.

Does a model predict examples that it was really not fitted to?

The closed form for leaving one example out takes the networks for linear. A flexible one finds
ways to agree with an example that this does not see, so a close decision in its favour is checked
by fits, from other starts, to parts of the examples.

Learn the robot that is there: which parts of the model, with which parameters, how sure.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.dataset import Dataset
from annik_core.errors import RobotMismatch
from annik_core.pose import FloatArray
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import TooFewMeasurements
from annik_training.calibration.estimation import FittedParameters, fit_parameters
from annik_training.calibration.model import GrayBoxModel, Part, nominal_kinematics
from annik_training.calibration.observations import Noise, Observations, is_measured_alike
from annik_training.calibration.outliers import find_outliers, stiff_and_flexible
from annik_training.calibration.uncertainty import (
    check_examples,
    error_bound_of,
    unidentified_parameters,
)
from annik_training.fitting.threads import one_thread

_FOLDS = 5


def predicts_better(
    flexible: GrayBoxModel,
    simple: GrayBoxModel,
    observations: Observations,
    noise: Noise,
    rng: np.random.Generator,
) -> bool:
    """Whether the flexible model's held-out errors are less, by more than a standard error.

    Args:
        flexible: the model in question.
        simple: what would be used instead.
        observations: all examples, outliers left out.
        noise: of the observations.
        rng: divides the examples, and starts the networks.
    """
    fold = rng.permutation(len(observations)) % _FOLDS
    gains = np.subtract(
        *(_held_out_squares(model, observations, noise, fold, rng) for model in (simple, flexible))
    )
    return bool(gains.mean() > gains.std(ddof=1) / math.sqrt(len(gains)))


def _held_out_squares(
    model: GrayBoxModel,
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
        fitted = fit_parameters(model, rest, noise, model.start(rng))
        where = model.positions_and_rotations(fitted.parameters, held_out.joint_positions)
        squares[fold == number] = (held_out.residuals(*where, noise) ** 2).sum(axis=1)
    return squares


#: What may be used, the simplest first.
CANDIDATES: tuple[frozenset[Part], ...] = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT}),
    frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_NETWORKS}),
    frozenset(Part),
)
#: Where nobody says how well the poses were measured, to begin with [m], [rad].
_UNKNOWN_NOISE = Noise(5e-5, 5e-5)
#: Random starts of the networks; the fits to few examples have other minima.
_STARTS = 2
#: Standard errors by which the closed form must find a model better to be believed at once.
_CLOSE = 4.0
_EVALUATIONS = 100
#: How often the noise is estimated anew.
_NOISE_ROUNDS = 3


@dataclass(frozen=True)
class Candidate:
    """How a model with some of the parts predicts examples that it was not fitted to.

    Attributes:
        parts: what it uses.
        parameters: how many that are.
        score: mean square of the left-out residuals, in standard deviations of the noise.
        standard_error: of the score.
    """

    parts: frozenset[Part]
    parameters: int
    score: float
    standard_error: float


@dataclass(frozen=True, eq=False)
class LearnedRobot:
    """A robot as learned from measured poses.

    Attributes:
        dataset: the measured poses.
        fitted: the parameters, and how well they are known.
        candidates: what could have been used; ``fitted.model.parts`` is.
        outliers: ``(n,)`` which of the examples were left out.
        seed: of the starts.
        seconds: wall time.
    """

    dataset: Dataset
    fitted: FittedParameters
    candidates: tuple[Candidate, ...]
    outliers: NDArray[np.bool_]
    seed: int
    seconds: float

    @cached_property
    def robot(self) -> Robot:
        """The nominal robot with the corrections; its definition carries them."""
        fitted = self.fitted
        corrections = replace(
            fitted.model.corrections(fitted.parameters),
            error_bound=error_bound_of(
                fitted, self.measured_noise, np.random.default_rng(self.seed)
            ),
            provenance=self.provenance,
        )
        nominal = self.dataset.robot
        definition = {**nominal.definition, "corrections": corrections.to_dict()}
        return robot_from_definition(definition, f"learned {nominal.name}")

    @property
    def provenance(self) -> dict[str, Any]:
        """From what it was learned, and how, as plain data."""
        noise = self.fitted.noise
        return {
            "examples": len(self.dataset),
            "outliers": np.flatnonzero(self.outliers).tolist(),
            "dataset_hash": self.dataset.content_hash,
            "measurements_hash": self.dataset.measurements_hash,
            "position_only": not self.fitted.observations.has_orientation,
            "parts": sorted(part.value for part in self.fitted.model.parts),
            "position_noise": noise.position,
            "orientation_noise": noise.orientation,
            "unidentified": list(self.unidentified),
            "seed": self.seed,
        }

    @property
    def measured_noise(self) -> Noise:
        """What the measurements' own spread says; else all that the model leaves unexplained."""
        noise = self.dataset.measurement_noise
        return self.fitted.noise if noise is None else Noise(*noise)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Geometric errors that these examples say little of; they stay near the nominal."""
        return unidentified_parameters(self.fitted)


def learn_robot(dataset: Dataset, seed: int = 0, *, position_only: bool = False) -> LearnedRobot:
    """Learn a robot from measured poses.

    Args:
        dataset: joint positions as commanded and poses as measured; its robot is the nominal one.
        seed: of the starts of the networks.
        position_only: the orientations were not measured and mean nothing.

    Raises:
        UnsupportedRobot: if it is no nominal arm.
        TooFewMeasurements: naming the least number.
        TooManyOutliers: if the poses are not this robot's.
        UnexplainedMeasurements: likewise.
        ImplausibleErrors: if they are another robot's.
        DegenerateExamples: naming the joints to move.
        NonFiniteValue: if a number is none.
    """
    begin = time.perf_counter()
    nominal_kinematics(dataset.robot)
    observations = Observations.of(dataset, position_only=position_only)
    with one_thread():
        fitted, candidates, outliers = _learn(dataset, observations, seed)
    return LearnedRobot(dataset, fitted, candidates, outliers, seed, time.perf_counter() - begin)


def with_nominal(dataset: Dataset, nominal: Robot) -> Dataset:
    """The same measured poses, for another description of the robot.

    Raises:
        RobotMismatch: if that has other joints, or other frames that poses are between.
    """
    measured = dataset.robot
    if not is_measured_alike(nominal, measured):
        raise RobotMismatch("the measured poses", _described(nominal), _described(measured))
    return replace(dataset, robot=nominal)


def _described(robot: Robot) -> str:
    frames = f"{robot.base_frame} to {robot.end_effector_frame}"
    return f"{robot.name} ({', '.join(robot.joint_names)}; {frames})"


def _learn(
    dataset: Dataset, observations: Observations, seed: int
) -> tuple[FittedParameters, tuple[Candidate, ...], NDArray[np.bool_]]:
    rng = np.random.default_rng(seed)
    robot = dataset.robot
    _check_number(robot, observations, 0)
    noise = _UNKNOWN_NOISE
    if dataset.measurement_noise is not None:
        noise = _at_least(Noise(*dataset.measurement_noise))
    models = stiff_and_flexible(GrayBoxModel(robot, CANDIDATES[0]))
    outliers = find_outliers(models, observations, noise, rng)
    kept = observations.where(~outliers)
    _check_number(robot, kept, int(outliers.sum()))
    fits = [_fit(GrayBoxModel(robot, parts), kept, noise, rng) for parts in CANDIDATES]
    candidates = tuple(_judged(fitted) for fitted in fits)
    fitted = fits[_confirmed(robot, _chosen(candidates), candidates, kept, noise, rng)]
    for _ in range(_NOISE_ROUNDS):
        noise = estimated_noise(fitted, dataset.measurement_noise)
        fitted = fit_parameters(fitted.model, kept, noise, fitted.parameters, _EVALUATIONS)
    check_examples(fitted, rng)
    return fitted, candidates, outliers


def _check_number(robot: Robot, observations: Observations, outliers: int) -> None:
    parameters = GrayBoxModel(robot, CANDIDATES[0]).size
    least = math.ceil(2 * parameters / observations.rows)
    if len(observations) < least:
        raise TooFewMeasurements(len(observations), least, outliers)


def _at_least(noise: Noise) -> Noise:
    """Noise that can be divided by: an ideal robot's measurements have none [m], [rad]."""
    return Noise(max(noise.position, 1e-7), max(noise.orientation, 1e-7))


def _fit(
    model: GrayBoxModel, observations: Observations, noise: Noise, rng: np.random.Generator
) -> FittedParameters:
    """The best of some starts."""
    starts = _STARTS if Part.JOINT_NETWORKS in model.parts else 1
    fits = [
        fit_parameters(model, observations, noise, model.start(rng), _EVALUATIONS)
        for _ in range(starts)
    ]
    return min(fits, key=lambda fitted: fitted.cost)


def _judged(fitted: FittedParameters) -> Candidate:
    squares = (fitted.left_out_residuals**2).mean(axis=1)
    error = float(squares.std(ddof=1)) / math.sqrt(len(squares))
    return Candidate(fitted.model.parts, fitted.model.size, float(squares.mean()), error)


def _chosen(candidates: tuple[Candidate, ...]) -> int:
    """The simplest whose score is the best but for one standard error."""
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
    """The choice, or the best simpler candidate, if the choice was close and does not hold."""
    if chosen == 0:
        return chosen
    simpler = min(range(chosen), key=lambda index: candidates[index].score)
    gain = candidates[simpler].score - candidates[chosen].score
    if gain > _CLOSE * candidates[simpler].standard_error:
        return chosen
    flexible, simple = (
        GrayBoxModel(robot, candidates[index].parts) for index in (chosen, simpler)
    )
    return chosen if predicts_better(flexible, simple, observations, noise, rng) else simpler


def estimated_noise(fitted: FittedParameters, known: tuple[float, float] | None) -> Noise:
    """What a fit leaves unexplained, by the degrees of freedom that it leaves.

    Args:
        fitted: the fit.
        known: spread of the measurements [m], [rad], below which there is no noise.
    """
    squares, leverages = fitted.residuals**2, fitted.leverages
    taken = np.einsum("nrr->r", leverages)
    factors = []
    for rows in (slice(0, 3), slice(3, 6)):
        left = squares[:, rows].size - float(taken[rows].sum())
        total = float(squares[:, rows].sum())
        factors.append(math.sqrt(total / left) if left > 0.0 else 1.0)
    noise = Noise(fitted.noise.position * factors[0], fitted.noise.orientation * factors[1])
    if known is not None:
        noise = Noise(max(noise.position, known[0]), max(noise.orientation, known[1]))
    return _at_least(noise)

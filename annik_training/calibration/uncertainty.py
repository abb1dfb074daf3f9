"""Uncertainty of a calibration: parameters, joints, and the error bound of each pose."""

import math
from dataclasses import replace

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import ErrorBound, quadratic_features
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import (
    DegenerateExamples,
    ImplausibleErrors,
    UnexplainedMeasurements,
)
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations

#: Posterior standard deviation, in those of the prior, of a parameter that is not identified.
_UNIDENTIFIED = 0.5
#: Least motion of a joint, as a fraction of its interval.
_MOVED = 0.02
#: A geometric error of more natural units means another robot.
_IMPLAUSIBLE = 30.0
#: Fixed points that are nearer to each other than so many times what the nominal arm tells.
_SMALLER = 0.5
#: Number of random poses that the examples are checked with.
_CHECKED_POSES = 300
#: Standard errors by which the residuals must exceed the measurements' noise to be the robot's.
_SIGNIFICANT = 2.0
_POSES = 2000
_DRAWS = 400
#: The poses are evaluated in this many parts, so that their derivatives stay in the cache.
_PARTS = 40
CONFIDENCE = 0.95
#: More than the confidence, since sizes and noise of the fit know the example that is left out.
_MARGIN = 0.015
#: A quantile of few residuals is uncertain: it is widened by so many times one over their number.
_FEW = 5.0
#: A bound shrinks at most by this factor; by the second one where the residuals are mostly the
#: known noise of the measurements, so that they tell little of the robot; by the third with fixed
#: points, whose few placements tell little of other places.
_LEAST_FACTORS = (0.01, 0.3, 0.5)
#: 95th percentile of the length of three independent standard normal coordinates.
_NOISE_BOUND = 2.795


def unidentified_parameters(fitted: Estimate) -> tuple[str, ...]:
    """Names of the geometric errors that the examples don't identify.

    Weights of networks are excluded: a single weight has no meaning.
    """
    errors = fitted.model.errors
    deviations = np.sqrt(np.diag(fitted.covariance)[: len(errors)])
    deviations = deviations / np.minimum(fitted.own_prior[: len(errors)], 1.0)
    return tuple(
        error.name
        for error, deviation in zip(errors, deviations, strict=True)
        if deviation > _UNIDENTIFIED
    )


def check_moved(
    robot: Robot, observations: Observations, noise: Noise, rng: np.random.Generator
) -> None:
    """Refuse examples in which a joint hardly moves: they can't tell its errors.

    Raises:
        DegenerateExamples: naming the joints.
    """
    box, positions = robot.joint_box, observations.joint_positions
    widths = box.upper - box.lower
    moved = np.ptp(positions, axis=0)
    still = [index for index in box.free.tolist() if moved[index] < _MOVED * widths[index]]
    if not still:
        return
    model = ParametricModel(robot, frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_SERIES}))
    joint_positions = box.sample(_CHECKED_POSES, rng)
    start = np.zeros(model.size + observations.frames.size)
    informed = Estimate(model, start, observations, noise)
    columns = model.evaluate(start[: model.size], joint_positions).columns
    left, unknown = (
        np.array(
            [
                np.sqrt(np.quantile((part[:, rows] ** 2).sum(axis=(1, 2)), 0.9))
                for rows in (slice(0, 3), slice(3, 6))
            ]
        )
        for part in (columns @ informed.root[: model.size], columns)
    )
    fraction = float((left / unknown)[: observations.rows // 3].max())
    names = tuple(robot.joint_names[index] for index in still)
    raise DegenerateExamples((float(left[0]), float(left[1])), min(fraction, 1.0), names)


def check_size(fitted: Estimate) -> None:
    """Refuse an arm that is much smaller than described, so that fixed points nearly coincide.

    Raises:
        UnexplainedMeasurements: if it is.
    """
    frames = fitted.observations.frames
    described, found = (
        float(np.sqrt(np.square(points - points.mean(axis=0)).sum())) if len(points) else 0.0
        for points in (frames.points, frames.moved(fitted.unknowns).points)
    )
    if found < _SMALLER * described:
        raise UnexplainedMeasurements(
            f"the fixed points would be {found / described:.2g} times as far apart as by "
            "the robot as described"
        )


def check_explained(fitted: Estimate, rng: np.random.Generator) -> None:
    """Refuse an estimate that is too far from the measurements or from the nominal robot.

    Raises:
        UnexplainedMeasurements: if it is far from the measurements.
        ImplausibleErrors: if it is another robot.
    """
    check_size(fitted)
    robot = fitted.model.robot
    model = ParametricModel(robot, frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_SERIES}))
    joint_positions = robot.joint_box.sample(_CHECKED_POSES, rng)
    columns = model.evaluate(np.zeros(model.size), joint_positions).columns
    # Errors of a robot that was not measured, distance [m] and angle [rad].
    unlearned = np.array(
        [
            np.sqrt(np.quantile((columns[:, rows] ** 2).sum(axis=(1, 2)), 0.9))
            for rows in (slice(0, 3), slice(3, 6))
        ]
    )
    noise, measured = fitted.noise, fitted.observations.rows // 3
    unexplained = math.sqrt(3.0) * np.array([noise.position, noise.orientation])
    unexplained[measured:] = 0.0
    if not (unexplained <= unlearned).all():
        raise UnexplainedMeasurements(
            f"the measured poses are {1e3 * unexplained[0]:.2g} mm and "
            f"{math.degrees(unexplained[1]):.2g} degrees from the nearest model of the robot"
        )
    errors = [
        (abs(parameter), error, fitted.model.amount(error, parameter))
        for error, parameter in zip(
            fitted.model.errors, fitted.model_parameters.tolist(), strict=False
        )
        # The measured end effector may be another than the nominal one: a probe, a marker.
        if error.place < fitted.model.robot.dof
    ]
    wrong = sorted((one for one in errors if one[0] > _IMPLAUSIBLE), key=lambda one: -one[0])[:3]
    if wrong:
        raise ImplausibleErrors(
            [error.name for _, error, _ in wrong],
            [
                f"{math.degrees(amount):.3g} degrees"
                if error.is_rotation
                else f"{1e3 * amount:.3g} mm"
                for _, error, amount in wrong
            ],
        )


def error_bound_of(
    fitted: Estimate, measured_noise: Noise, rng: np.random.Generator
) -> ErrorBound:
    """The error that 95 of 100 poses stay below, as a function of the joint positions.

    By robots drawn from the posterior. Residuals beyond the noise of the measurements are added as
    independent errors of the robot at each pose.

    The errors are those of the tool, in the frame of the instrument. Fixed points have none:
    there they are what remains after the motion of the base that makes them least.
    """
    model, measured_at = fitted.model, fitted.observations.joint_positions
    # In the joint box, and as much where it was measured, which may be a small part of it.
    joint_positions = np.concatenate(
        [
            model.robot.joint_box.sample(_POSES, rng),
            measured_at[rng.integers(len(measured_at), size=_POSES)],
        ]
    )
    steps = fitted.root @ rng.normal(size=(len(fitted.parameters), _DRAWS))
    draws = _motions(fitted, joint_positions, max(1.0, _calibration(fitted)) * steps)
    centre, half = fitted.model.scale
    features = quadratic_features(np.clip((joint_positions - centre) / half, -1.0, 1.0))
    coefficients = []
    for rows, noise, known in (
        (slice(0, 3), fitted.noise.position, measured_noise.position),
        (slice(3, 6), fitted.noise.orientation, measured_noise.orientation),
    ):
        least = noise**2 / (1.0 + _SIGNIFICANT * math.sqrt(2.0 / fitted.degrees_of_freedom))
        unexplained = math.sqrt(max(0.0, least - known**2))
        shape = draws[:, rows].shape
        errors = np.linalg.norm(draws[:, rows] + unexplained * rng.normal(size=shape), axis=1)
        logarithms = np.log(np.quantile(errors, CONFIDENCE, axis=1))
        fit = np.linalg.lstsq(features, logarithms, rcond=None)[0]
        # Shifted so that the bound holds on average: the parabola is only an approximation.
        ratios = errors / np.exp(features @ fit)[:, None]
        fit[0] += math.log(float(np.quantile(ratios, CONFIDENCE)))
        coefficients.append(fit)
    bound = ErrorBound(*model.scale, np.array(coefficients))
    for index, factor in enumerate(_held_out_factors(fitted, bound, measured_noise)):
        bound.coefficients[index, 0] += math.log(factor)
    return bound


def _motions(fitted: Estimate, joint_positions: FloatArray, steps: FloatArray) -> FloatArray:
    """Motions ``(n, 6, m)`` of the tool [m], [rad] by steps ``(p + u, m)`` of the parameters."""
    model, parameters = fitted.model, fitted.model_parameters
    parts = []
    for some in np.array_split(joint_positions, _PARTS):
        observations = replace(fitted.observations.elsewhere(some, None), has_orientation=True)
        evaluated = model.evaluate(parameters, some)
        columns = observations.derivatives(evaluated, Noise(1.0, 1.0), fitted.unknowns)
        used = columns.shape[2]
        parts.append((columns.reshape(-1, used) @ steps[:used]).reshape(len(some), 6, -1))
    motions = np.concatenate(parts)
    if fitted.observations.fixed_points is None:
        return motions
    tool = fitted.observations.frames.moved(fitted.unknowns).tool[:3, 3]
    positions, rotations = model.positions_and_rotations(parameters, joint_positions)
    points = positions + rotations @ tool
    base = np.zeros((len(points), 6, 6))
    base[:, range(6), range(6)] = 1.0
    base[:, :3, 3:] = -np.cross(points[:, None, :], np.eye(3)).swapaxes(1, 2)
    away = motions[:, :3].reshape(-1, motions.shape[2])
    return motions - base @ np.linalg.lstsq(base[:, :3].reshape(-1, 6), away, rcond=None)[0]


def _held_out_factors(
    fitted: Estimate, bound: ErrorBound, measured_noise: Noise
) -> tuple[float, float]:
    """Factors with which the bounds hold for held-out examples: conformal prediction.

    The error of an example by the fit without it, less the noise of its measurement, over its
    bound; of these ratios the quantile, and at least a tenth of the largest; a little more where
    rows or placements are few. References:
    [Vovk2005]_ V. Vovk, A. Gammerman, G. Shafer: Algorithmic learning in a random world.
    Springer, 2005.
    """
    bounds = bound.of_rows(fitted.observations.joint_positions)
    factors = [1.0, 1.0]
    counted = fitted.observations.weights > 0.0
    unseen = fitted.unseen_residuals
    held_out = fitted.held_out_residuals if unseen is None else unseen
    placements = fitted.observations.placements
    if placements is None:
        wider = 1.0 + _FEW / int(counted.sum())
    else:
        # A new place differs from the mean of some places by more than they differ from it. About
        # half of the squares of the residuals is of the place.
        wider = math.sqrt(1.0 + 0.5 / (1.0 + float(placements.max())))
    for index, (rows, scale, known) in enumerate(
        (
            (slice(0, 3), fitted.noise.position, measured_noise.position),
            (slice(3, 6), fitted.noise.orientation, measured_noise.orientation),
        )
    ):
        residuals = scale * held_out[counted][:, rows]
        if not residuals.size:
            continue
        squares = (residuals**2).sum(axis=1) - (_NOISE_BOUND * known) ** 2
        ratios = np.sqrt(np.maximum(squares, 0.0)) / bounds[counted, index]
        level = min(1.0, (CONFIDENCE + _MARGIN) * (1.0 + 1.0 / len(ratios)))
        least = _LEAST_FACTORS[0 if known < 0.5 * scale else 1]
        if fitted.observations.fixed_points is not None:
            least = _LEAST_FACTORS[2]
        largest = max(float(np.quantile(ratios, level)), 0.1 * float(ratios.max()))
        factors[index] = max(least, wider * largest)
    return factors[0], factors[1]


def _calibration(fitted: Estimate) -> float:
    """Ratio of the leave-one-out residuals to those that the estimate expects."""
    weights = fitted.observations.weights
    squares = weights * np.einsum("nr,nr->n", fitted.residuals, fitted.left_out_residuals)
    return math.sqrt(float(squares.mean()) / fitted.observations.rows)

"""What measured poses leave unknown: parameters, joints, and the error to expect of each pose."""

from __future__ import annotations

import math

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import ErrorBound, quadratic_features
from annik_training.calibration.errors import (
    DegenerateExamples,
    ImplausibleErrors,
    UnexplainedMeasurements,
)
from annik_training.calibration.estimation import FittedParameters
from annik_training.calibration.model import GrayBoxModel, Part, correction_name
from annik_training.calibration.observations import Noise

#: Part of the prior's standard deviation that is left of an unidentified parameter.
_UNIDENTIFIED = 0.5
#: More than this part of the error that a robot not measured at all is expected to have, and
#: nothing was learned in a part of the working box.
_MOST_ERROR = 0.1
#: Part of the variance of a joint's correction that, left unlearned, makes it one to blame.
_BLAME = 0.2
#: A geometric error of this many natural units is none, but another robot.
_IMPLAUSIBLE = 30.0
#: Random networks, and poses, by which examples are judged.
_NETWORKS, _CHECKED_POSES = 4, 500
#: Standard errors by which the noise must exceed that of the measurements to be the robot's.
_DOUBT = 2.0
_POSES = 2000
_DRAWS = 400
CONFIDENCE = 0.95


def unidentified_parameters(fitted: FittedParameters) -> tuple[str, ...]:
    """Names of the geometric errors of which the examples say little.

    The networks' weights are left out: one by one they mean nothing.
    """
    errors = fitted.model.errors
    deviations = np.sqrt(np.diag(fitted.covariance)[: len(errors)])
    return tuple(
        error.name
        for error, deviation in zip(errors, deviations, strict=True)
        if deviation > _UNIDENTIFIED
    )


def check_examples(fitted: FittedParameters, rng: np.random.Generator) -> None:
    """Refuse examples that leave a part of the working box unknown, or are not this robot's.

    What they tell is judged by all geometric errors and the joint networks, whether the fit uses
    them or not, and by networks drawn at random: where nothing was learned, the fitted ones say
    nothing, as if that were known.

    Raises:
        UnexplainedMeasurements: if they are nowhere near the fit.
        ImplausibleErrors: if the fit is no such robot.
        DegenerateExamples: naming the joints to move.
    """
    model = GrayBoxModel(fitted.model.robot, frozenset(Part) - {Part.POSE_NETWORK})
    joint_positions = model.robot.joint_box.sample(_CHECKED_POSES, rng)
    joints = model.robot.joint_names
    left, unknown = np.zeros((2, _CHECKED_POSES)), np.zeros((2, _CHECKED_POSES))
    unlearned_parts = dict.fromkeys(joints, 0.0)
    for _ in range(_NETWORKS):
        parameters = model.start(rng)
        parameters[len(model.errors) :] = rng.normal(size=model.size - len(model.errors))
        informed = FittedParameters(model, parameters, fitted.observations, fitted.noise)
        columns = model.evaluate(parameters, joint_positions).columns
        for index, rows in enumerate((slice(0, 3), slice(3, 6))):
            of_pose = columns[:, rows]
            left[index] += ((of_pose @ informed.root) ** 2).sum(axis=(1, 2)) / _NETWORKS
            unknown[index] += (of_pose**2).sum(axis=(1, 2)) / _NETWORKS
        for index, joint in enumerate(joints):
            unlearned_parts[joint] += _unlearned_part(informed, joint_positions, index) / _NETWORKS
    # The worst tenth of the box; the very worst pose would be one out of reach of any design.
    expected, unlearned = (np.sqrt(np.quantile(part, 0.9, axis=1)) for part in (left, unknown))
    _check_explained(fitted, unlearned)
    ratios = (expected / unlearned)[: fitted.observations.rows // 3]
    if (ratios <= _MOST_ERROR).all():
        return
    least = min(_BLAME, max(unlearned_parts.values()))
    blamed = tuple(joint for joint in joints if unlearned_parts[joint] >= least)
    amount = f"{1e3 * expected[0]:.2g} mm and {math.degrees(expected[1]):.2g} degrees"
    raise DegenerateExamples(amount, float(ratios.max()), blamed)


def _unlearned_part(fitted: FittedParameters, joint_positions: FloatArray, index: int) -> float:
    """Which part of the variance of a joint's correction the examples leave, 0 to 1.

    But for its mean over the box, which the zero of the joint says as well.
    """
    model = fitted.model
    own = [name == correction_name(model.robot.joint_names[index]) for name in model.names]
    slopes = model.correction_slopes(fitted.parameters, joint_positions, index)
    slopes -= slopes.mean(axis=0)
    prior = float((slopes**2).sum())
    # A joint that is locked has no correction.
    return float(((slopes @ fitted.root[own]) ** 2).sum()) / prior if prior > 0.0 else 0.0


def _check_explained(fitted: FittedParameters, unlearned: FloatArray) -> None:
    """Refuse a fit that is farther from the examples, or the description, than makes sense.

    Args:
        fitted: the fit.
        unlearned: distance [m] and angle [rad] that a robot not measured at all is off.

    Raises:
        UnexplainedMeasurements: likewise.
        ImplausibleErrors: likewise.
    """
    noise, measured = fitted.noise, fitted.observations.rows // 3
    unexplained = math.sqrt(3.0) * np.array([noise.position, noise.orientation])
    unexplained[measured:] = 0.0
    if not (unexplained <= unlearned).all():
        raise UnexplainedMeasurements(*unexplained.tolist())
    errors = [
        (abs(parameter), error, fitted.model.amount(error, parameter))
        for error, parameter in zip(fitted.model.errors, fitted.parameters.tolist(), strict=False)
        # The end effector may be another than the description's: a probe, a marker.
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
    fitted: FittedParameters, measured_noise: Noise, rng: np.random.Generator
) -> ErrorBound:
    """The error that 95 of 100 poses stay below, as a function of the joint positions.

    By robots drawn from the posterior: what the model does not explain beyond the noise of the
    measurements is added as if it were the robot's own, unlike from pose to pose.

    Args:
        fitted: the model and how well it is known.
        measured_noise: of the measurements alone.
        rng: for the draws.
    """
    model = fitted.model
    joint_positions = model.robot.joint_box.sample(_POSES, rng)
    columns = model.evaluate(fitted.parameters, joint_positions).columns
    draws = (columns @ fitted.root) @ rng.normal(size=(model.size, _DRAWS))
    draws *= max(1.0, _calibration(fitted))
    features = quadratic_features(_scaled(fitted, joint_positions))
    coefficients = []
    for rows, noise, known in (
        (slice(0, 3), fitted.noise.position, measured_noise.position),
        (slice(3, 6), fitted.noise.orientation, measured_noise.orientation),
    ):
        least = noise**2 / (1.0 + _DOUBT * math.sqrt(2.0 / fitted.degrees_of_freedom))
        unexplained = math.sqrt(max(0.0, least - known**2))
        shape = draws[:, rows].shape
        errors = np.linalg.norm(draws[:, rows] + unexplained * rng.normal(size=shape), axis=1)
        logarithms = np.log(np.quantile(errors, CONFIDENCE, axis=1))
        fit = np.linalg.lstsq(features, logarithms, rcond=None)[0]
        # The parabola is above the truth here and below it there: right on the whole.
        ratios = errors / np.exp(features @ fit)[:, None]
        fit[0] += math.log(float(np.quantile(ratios, CONFIDENCE)))
        coefficients.append(fit)
    return ErrorBound(*model.scale, np.array(coefficients))


def _calibration(fitted: FittedParameters) -> float:
    """How much larger the left-out residuals are than the fit expects them to be."""
    rest = np.eye(fitted.observations.rows) - fitted.leverages
    residuals = fitted.residuals
    squares = np.einsum("nr,nr->n", residuals, np.linalg.solve(rest, residuals[..., None])[..., 0])
    return math.sqrt(float(squares.mean()) / fitted.observations.rows)


def _scaled(fitted: FittedParameters, joint_positions: FloatArray) -> FloatArray:
    centre, half = fitted.model.scale
    scaled: FloatArray = (joint_positions - centre) / half
    return scaled

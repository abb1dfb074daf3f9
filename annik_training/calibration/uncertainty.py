"""Uncertainty of a calibration: parameters, joints, and the error bound of each pose."""

import math

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import ErrorBound, quadratic_features
from annik_training.calibration.errors import (
    DegenerateExamples,
    ImplausibleErrors,
    UnexplainedMeasurements,
)
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.model import ParametricModel, Part, correction_name
from annik_training.calibration.observations import Noise

#: Posterior standard deviation from which a parameter counts as unidentified; the prior's is 1.
_UNIDENTIFIED = 0.5
#: Largest remaining error, as a fraction of that of a robot that was not measured at all.
_MOST_ERROR = 0.1
#: Remaining fraction of the variance of a joint's correction from which the joint is named.
_NAMED = 0.2
#: A geometric error of more natural units means another robot.
_IMPLAUSIBLE = 30.0
#: Number of random networks and poses that the examples are checked with.
_NETWORKS, _CHECKED_POSES = 4, 500
#: Standard errors by which the residuals must exceed the measurements' noise to be the robot's.
_SIGNIFICANT = 2.0
_POSES = 2000
_DRAWS = 400
CONFIDENCE = 0.95


def unidentified_parameters(fitted: Estimate) -> tuple[str, ...]:
    """Names of the geometric errors that the examples don't identify.

    Weights of networks are excluded: a single weight has no meaning.
    """
    errors = fitted.model.errors
    deviations = np.sqrt(np.diag(fitted.covariance)[: len(errors)])
    return tuple(
        error.name
        for error, deviation in zip(errors, deviations, strict=True)
        if deviation > _UNIDENTIFIED
    )


def check_examples(fitted: Estimate, rng: np.random.Generator) -> None:
    """Refuse examples that don't determine the robot in the joint box, or are not this robot's.

    The check uses all geometric errors and joint networks drawn at random, whichever parts the
    model has. Fitted networks would hide what is unknown: their derivatives vanish where nothing
    was learned.

    Raises:
        UnexplainedMeasurements: if they are far from the estimate.
        ImplausibleErrors: if the estimate is another robot.
        DegenerateExamples: naming the joints to move.
    """
    model = ParametricModel(fitted.model.robot, frozenset(Part) - {Part.POSE_NETWORK})
    joint_positions = model.robot.joint_box.sample(_CHECKED_POSES, rng)
    joints = model.robot.joint_names
    left, unknown = np.zeros((2, _CHECKED_POSES)), np.zeros((2, _CHECKED_POSES))
    remaining = dict.fromkeys(joints, 0.0)
    for _ in range(_NETWORKS):
        parameters = model.start(rng)
        parameters[len(model.errors) :] = rng.normal(size=model.size - len(model.errors))
        informed = Estimate(model, parameters, fitted.observations, fitted.noise)
        columns = model.evaluate(parameters, joint_positions).columns
        for index, rows in enumerate((slice(0, 3), slice(3, 6))):
            of_pose = columns[:, rows]
            left[index] += ((of_pose @ informed.root) ** 2).sum(axis=(1, 2)) / _NETWORKS
            unknown[index] += (of_pose**2).sum(axis=(1, 2)) / _NETWORKS
        for index, joint in enumerate(joints):
            remaining[joint] += _unlearned_part(informed, joint_positions, index) / _NETWORKS
    # The worst tenth of the box; no design reaches the very worst pose.
    expected, unlearned = (np.sqrt(np.quantile(part, 0.9, axis=1)) for part in (left, unknown))
    _check_explained(fitted, unlearned)
    ratios = (expected / unlearned)[: fitted.observations.rows // 3]
    if (ratios <= _MOST_ERROR).all():
        return
    least = min(_NAMED, max(remaining.values()))
    named = tuple(joint for joint in joints if remaining[joint] >= least)
    raise DegenerateExamples((float(expected[0]), float(expected[1])), float(ratios.max()), named)


def _unlearned_part(fitted: Estimate, joint_positions: FloatArray, index: int) -> float:
    """Remaining fraction, 0 to 1, of the variance of a joint's correction.

    Without the mean over the box, which the joint's zero contains as well.
    """
    model = fitted.model
    own = [name == correction_name(model.robot.joint_names[index]) for name in model.names]
    derivatives = model.correction_derivatives(fitted.parameters, joint_positions, index)
    derivatives -= derivatives.mean(axis=0)
    prior = float((derivatives**2).sum())
    # A locked joint has no correction.
    return float(((derivatives @ fitted.root[own]) ** 2).sum()) / prior if prior > 0.0 else 0.0


def _check_explained(fitted: Estimate, unlearned: FloatArray) -> None:
    """Refuse an estimate that is too far from the measurements or from the nominal robot.

    ``unlearned`` is the error of a robot that was not measured, distance [m] and angle [rad].
    """
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
        for error, parameter in zip(fitted.model.errors, fitted.parameters.tolist(), strict=False)
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
    """
    model = fitted.model
    joint_positions = model.robot.joint_box.sample(_POSES, rng)
    columns = model.evaluate(fitted.parameters, joint_positions).columns
    draws = (columns @ fitted.root) @ rng.normal(size=(model.size, _DRAWS))
    draws *= max(1.0, _calibration(fitted))
    centre, half = fitted.model.scale
    features = quadratic_features((joint_positions - centre) / half)
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
    return ErrorBound(*model.scale, np.array(coefficients))


def _calibration(fitted: Estimate) -> float:
    """Ratio of the leave-one-out residuals to those that the estimate expects."""
    squares = np.einsum("nr,nr->n", fitted.residuals, fitted.left_out_residuals)
    return math.sqrt(float(squares.mean()) / fitted.observations.rows)

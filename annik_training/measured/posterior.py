"""What measured poses leave unknown: parameters, joints, and the error to expect of each pose."""

from __future__ import annotations

import math

import numpy as np

from annik_core.error_bound import ErrorBound, quadratic_features
from annik_core.pose import FloatArray
from annik_training.measured.errors import DegenerateExamples
from annik_training.measured.fit_parameters import FittedParameters
from annik_training.measured.observations import Noise

#: Part of the prior's standard deviation that is left of an unidentified parameter.
_UNIDENTIFIED = 0.5
#: More than this part of the error that a robot not measured at all is expected to have, and
#: nothing was learned in a part of the working box.
_MOST_ERROR = 0.1
#: Part of the variance that makes a joint one of those to blame.
_BLAME = 0.2
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
    """Refuse examples that leave a part of the working box unknown.

    Raises:
        DegenerateExamples: naming the joints to move.
    """
    derivatives = _position_derivatives(fitted, rng)
    left = np.einsum("nip,pq,niq->n", derivatives, fitted.covariance, derivatives, optimize=True)
    nominal = (derivatives**2).sum(axis=(1, 2))
    # The worst tenth of the box; the very worst pose would be one out of reach of any design.
    expected, unlearned = (math.sqrt(np.quantile(part, 0.9)) for part in (left, nominal))
    if expected <= _MOST_ERROR * unlearned:
        return
    names, joints = fitted.model.names, fitted.model.robot.joint_names
    shares = {}
    for joint in joints:
        of_joint = np.array([name.startswith(f"{joint}:") for name in names])
        part = derivatives[:, :, of_joint]
        covariance = fitted.covariance[np.ix_(of_joint, of_joint)]
        shares[joint] = float(np.einsum("nip,pq,niq->", part, covariance, part, optimize=True))
    whole = sum(shares.values())
    worst = max(shares, key=lambda joint: shares[joint])
    blamed = tuple(joint for joint in joints if joint == worst or shares[joint] >= _BLAME * whole)
    raise DegenerateExamples(expected, unlearned, blamed)


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
    root = np.linalg.cholesky(fitted.covariance)
    draws = (columns @ root) @ rng.normal(size=(model.size, _DRAWS))
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


def _position_derivatives(fitted: FittedParameters, rng: np.random.Generator) -> FloatArray:
    """``(n, 3, p)`` of the position at random poses of the working box."""
    joint_positions = fitted.model.robot.joint_box.sample(_POSES, rng)
    return fitted.model.evaluate(fitted.parameters, joint_positions).columns[:, :3]

"""A design for calibrating an arm: joint positions at which its kinematic errors show best.

D-optimal, greedily: of many random joint positions, the next is always the one that adds most to
the determinant of the information on the parameters of the largest model that a calibration may
choose [Mitchell1974]_, each counted in natural units.

References:
    [Mitchell1974] T. J. Mitchell: An algorithm for the construction of "D-optimal" experimental
    designs. Technometrics 16 (2), 1974.
"""

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.calibration.calibrate import CANDIDATES
from annik_training.calibration.model import ParametricModel
from annik_training.calibration.observations import Noise

#: Joint positions to choose from.
_CANDIDATES = 1000
#: Weighs the lengths [m] and angles [rad] of a measured pose against each other.
_NOISE = Noise(5e-5, 5e-5)


def identifiability_design(robot: Robot, examples: int, rng: np.random.Generator) -> FloatArray:
    """Joint positions ``(examples, dof)`` [rad or m] inside the joint box of a nominal arm.

    At most :data:`_CANDIDATES` examples, chosen from so many drawn ones.

    Raises:
        UnsupportedRobot: if the arm is calibrated already.
    """
    model = ParametricModel(robot, max(CANDIDATES, key=len))
    candidates = robot.joint_box.sample(_CANDIDATES, rng)
    columns = model.evaluate(np.zeros(model.size), candidates).columns
    rows = np.concatenate(
        [columns[:, :3] / _NOISE.position, columns[:, 3:] / _NOISE.orientation], axis=1
    )
    return candidates[most_informative(rows, examples, np.eye(model.size))]


def most_informative(rows: FloatArray, count: int, covariance: FloatArray) -> list[int]:
    """Indices of the measurements that tell most about parameters, chosen one after another.

    Args:
        rows: ``(n, r, p)`` derivatives of each measurement by the parameters, in standard
            deviations of the noise.
        count: how many, at most n.
        covariance: ``(p, p)`` of the parameters before.
    """
    # Covariance of each candidate's measurement, given those chosen.
    uncertainty = rows @ covariance @ np.swapaxes(rows, 1, 2)
    identity = np.eye(rows.shape[1])
    chosen: list[int] = []
    for _ in range(count):
        gains = np.linalg.slogdet(identity + uncertainty)[1]
        gains[chosen] = -np.inf
        best = int(np.argmax(gains))
        chosen.append(best)
        learned = rows[best] @ covariance
        inside = np.linalg.inv(identity + uncertainty[best])
        covariance = covariance - learned.T @ inside @ learned
        shared = rows @ learned.T
        uncertainty = uncertainty - shared @ inside @ np.swapaxes(shared, 1, 2)
    return chosen

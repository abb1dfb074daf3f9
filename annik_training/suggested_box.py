"""A joint box on one branch around some joint positions, as large as a search finds it.

Joint positions beyond a singularity are sought by sampling. A box grows from the given ones on all
sides until the first of them stops a side, and goes on with the others; that is repeated with
sides that grow at different speeds, and the largest box is kept. Then singularities are sought in
that box alone, and what is found makes the next box smaller. At last it is shrunk until nothing is
found.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.joint_box import NEARLY_A_TURN, beyond_singularity, mobility, regularity

_SAMPLES, _SPEEDS, _ROUNDS = 5000, 32, 12
#: Samples beyond a singularity that are kept of a round.
_MOST = 300
#: Joint positions whose least singular value is below this part of the usual one are singular.
_TOO_NEAR = 0.02
#: Rounds in a row that find nothing, and most rounds until then.
_CLEAN, _SHRINKINGS = 3, 40
#: How far a side stays away from the nearest sample beyond a singularity, as part of its growth.
_MARGIN = 0.03


class NoSuggestion(AnnikError):
    """No joint box can be suggested around some joint positions."""

    def __init__(self, reason: str, remedy: str) -> None:
        self.reason, self.remedy = reason, remedy
        super().__init__(f"no joint box is suggested: {reason}; {remedy}")


def suggested_box(robot: Robot, around: FloatArray | None = None) -> JointLimits:
    """The largest box that a search finds, inside the limits, without a singularity.

    Joints that the robot's joint box locks stay locked, and redundant joints that are too many are
    locked besides. Around joint positions ``(dof,)`` [rad or m]; by default around those, of some
    hundreds, that are farthest from a singularity.

    Raises:
        NoSuggestion: if the positions are outside the limits, or too near to a singularity.
    """
    if robot.kind != "arm":
        raise NoSuggestion(
            f"{robot.name} is not an arm", "its joint box is that of its definition"
        )
    limits, free = robot.joint_limits, robot.joint_box.free
    locks = [*mobility(robot).locks, *np.setdiff1d(np.arange(robot.dof), free).tolist()]
    middle, bounds = robot.joint_box.centre, [robot.joint_box.lower, robot.joint_box.upper]
    lower, upper = (np.where(np.isin(np.arange(robot.dof), locks), middle, b) for b in bounds)
    without_locks = JointLimits(limits.joint_names, lower, upper)
    sample = _inner_sample(without_locks)
    if around is None:
        around = sample[np.argmax(regularity(robot, without_locks, sample))]
    if not limits.contains(around):
        raise NoSuggestion("a joint is outside its limits", "give others, by --around JOINT=VALUE")
    usual = regularity(robot, without_locks, np.concatenate([around[np.newaxis], sample]))
    if usual[0] < _TOO_NEAR * np.median(usual):
        raise _too_near()
    lower, upper = np.maximum(limits.lower, -1e3), np.minimum(limits.upper, 1e3)
    turns = robot.rotary
    half = 0.5 * NEARLY_A_TURN
    lower = np.where(turns, np.maximum(lower, around - half), lower)
    upper = np.where(turns, np.minimum(upper, around + half), upper)
    lower[locks] = upper[locks] = around[locks]
    box, beyond = JointLimits(limits.joint_names, lower, upper), np.empty((0, robot.dof))
    for seed in range(_ROUNDS):
        found = beyond_singularity(robot, box, around, _SAMPLES, seed)
        if not len(found):
            break
        beyond = np.concatenate([beyond, found[:_MOST]])
        box = _largest(JointLimits(limits.joint_names, lower, upper), around, beyond)
    clean = 0
    for seed in range(_ROUNDS, _ROUNDS + _SHRINKINGS):
        if len(beyond_singularity(robot, box, around, _SAMPLES, seed)):
            clean, part = 0, 0.96
            low, high = (around + part * (bound - around) for bound in (box.lower, box.upper))
            box = JointLimits(limits.joint_names, low, high)
        else:
            clean += 1
        if clean == _CLEAN:
            return box
    raise _too_near()


def _too_near() -> NoSuggestion:
    reason = "the joint positions are too near to a singularity"
    return NoSuggestion(reason, "give others, by --around JOINT=VALUE")


def _inner_sample(box: JointLimits) -> FloatArray:
    unit = qmc.Sobol(len(box.lower), seed=0).random(512)
    sample: FloatArray = box.lower + (0.1 + 0.8 * unit) * (box.upper - box.lower)
    return sample


def _largest(box: JointLimits, around: FloatArray, beyond: FloatArray) -> JointLimits:
    """The largest of the boxes in ``box`` that grow to the points beyond ``(n, dof)``."""
    free = box.free
    reach = np.stack([around - box.lower, box.upper - around])[:, free]
    away = (beyond - around)[:, free]
    side = (away > 0.0).astype(np.int64)
    joints = np.arange(len(free))
    # (n, free), how much of the way to its end a side has to grow to reach a point.
    needed = np.abs(away) / np.maximum(reach[side, joints], 1e-9)
    speeds = 2.0 ** (4.0 * qmc.Sobol(2 * len(free), seed=0).random(_SPEEDS) - 2.0)
    best, largest = np.zeros_like(reach), -math.inf
    for speed in speeds.reshape(-1, 2, len(free)):
        grown = _grown(needed, side, speed)
        size = float(np.log(np.maximum(grown * reach, 1e-12).sum(axis=0)).sum())
        if size > largest:
            best, largest = grown * reach, size
    lower, upper = around.copy(), around.copy()
    lower[free] -= best[0]
    upper[free] += best[1]
    return JointLimits(box.joint_names, lower, upper)


def _grown(needed: FloatArray, side: NDArray[np.int64], speed: FloatArray) -> FloatArray:
    """How much of its way ``(2, free)`` each side grows, at its speed, without a point inside."""
    joints = np.arange(needed.shape[1])
    grown, inside = np.ones_like(speed), np.ones(len(needed), dtype=bool)
    times = needed / speed[side, joints]
    while inside.any():
        rows = np.flatnonzero(inside)
        last = times[rows].argmax(axis=1)
        first = np.argmin(times[rows, last])
        joint, end = last[first], side[rows[first], last[first]]
        grown[end, joint] = (1.0 - _MARGIN) * needed[rows[first], joint]
        stopped = (side[:, joint] == end) & (needed[:, joint] >= grown[end, joint])
        inside &= ~stopped & (needed <= grown[side, joints]).all(axis=1)
    return grown

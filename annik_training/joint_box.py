"""What the joint box of a robot leaves open: redundant joints, full turns, several branches."""

from typing import NamedTuple

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import FULL_TURN, Robot
from annik_core.robots.task import Task
from annik_core.solver.mode import SolverMode

_SAMPLES = 500
#: Straight lines of joint positions, and positions on each, that singularities are sought on.
_LINES, _STEPS = 200, 24
#: A singular value below this part of the greatest is zero, but for the digits of a URDF.
_ZERO = 1e-4
#: From this width on, both ends of a joint's interval are nearly the same position [rad].
NEARLY_A_TURN = FULL_TURN - 0.2
#: Limits beyond these are rather of another unit.
_USUAL_LIMITS = (
    ("revolute", 2.0 * FULL_TURN + 0.1, "degrees, but a URDF has rad"),
    ("prismatic", 20.0, "millimetres, but a URDF has m"),
)


class Mobility(NamedTuple):
    """How the end effector moves with the joints that are free."""

    dimensions: int  #: in which the end effector moves
    redundant: list[str]  #: joints that can move together while the end effector rests
    locks: list[int]  #: as many of them as are too many: without these, none is redundant


def mobility(robot: Robot) -> Mobility:
    """The mobility nearly everywhere in the joint box, singularities apart."""
    box, free = robot.joint_box, robot.joint_box.free
    jacobians = _scaled_jacobians(robot, _sample(box, _SAMPLES), box)
    _, values, directions = np.linalg.svd(jacobians)
    ranks = (values > _ZERO * values[:, :1]).sum(axis=1)
    dimensions = int(ranks.max())
    at_rest = np.abs(directions[ranks == dimensions, dimensions:]).max(axis=(0, 1), initial=0.0)
    kept, least = list(range(len(free))), dimensions - 1
    while len(kept) > dimensions:
        # Without it, the others move the end effector best.
        kept = max(
            ([other for other in kept if other != joint] for joint in kept),
            key=lambda rest: np.linalg.svd(jacobians[:, :, rest])[1][:, least].mean(),
        )
    return Mobility(
        dimensions,
        [robot.joint_names[joint] for joint in free[at_rest > 1e-3]],
        np.delete(free, kept).tolist(),
    )


def findings(robot: Robot) -> list[str]:
    """All that is to be known of a robot and its joint box before training, one line each."""
    if robot.kind != "arm":
        return ["one branch: every pose of the workspace has one solution"]
    box, limits, moves = robot.joint_box, robot.joint_limits, mobility(robot)
    names, kinds = np.array(robot.joint_names), np.array(robot.joint_types)
    found = []
    for kind, usual, unit in _USUAL_LIMITS:
        far = np.maximum(-limits.lower, limits.upper) > usual
        if odd := ", ".join(names[far & (kinds == kind)]):
            found.append(f"limits that look like {unit}: {odd}")
    whole = SolverMode.AUTO.of(robot) is SolverMode.WHOLE_ROBOT
    locks = " ".join(
        f"--joint-box {names[joint]}={box.centre[joint]:.3g}" for joint in moves.locks
    )
    dimensions = f"{len(box.free)} joints move: poses in {moves.dimensions} dimensions"
    if locks and whole:
        found.append(
            f"{dimensions}, with infinitely many solutions; along a path, the nearest to the "
            "previous command"
        )
    elif locks:
        found.append(
            f"{dimensions}, with infinitely many solutions. Lock {len(moves.locks)} of "
            f"{', '.join(moves.redundant)}, such as {locks}"
        )
    elif moves.dimensions < 6 and not whole:
        found.append(f"{dimensions} only, others are refused")
    if whole and (task := Task.AUTO.of(robot)) is not Task.POSE:
        found.append(
            f"{dimensions} only; task: {task.value}. Where a pose can't be reached, its position "
            "is, with the orientation as near as possible"
        )
    if whole:
        return [
            *found,
            "whole robot: solutions anywhere within the joint limits, on every branch; no joint "
            "box is needed",
        ]
    wide = box.upper - box.lower > NEARLY_A_TURN
    if turns := ", ".join(names[wide & (kinds == "revolute")]):
        found.append(
            f"the box of {turns} is a full turn: poses near its ends have a second solution at "
            "the other end, and are often not solved; a smaller box, by --joint-box, is better"
        )
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[moves.locks] = upper[moves.locks] = box.centre[moves.locks]
    branches = _branches(robot, JointLimits(box.joint_names, lower, upper))
    return [*found, f"with {locks}: {branches}" if locks else branches]


def regularity(robot: Robot, box: JointLimits, joint_positions: FloatArray) -> FloatArray:
    """How far from singular the Jacobians at joint positions ``(n, dof)`` are, in no unit.

    Of the joints that are free in a box.
    """
    jacobians = _scaled_jacobians(robot, joint_positions, box)
    values: FloatArray = np.linalg.svd(jacobians)[1]
    rank = int((values > _ZERO * values[:, :1]).sum(axis=1).max())
    return values[:, rank - 1]


def beyond_singularity(
    robot: Robot, box: JointLimits, start: FloatArray, count: int, seed: int
) -> FloatArray:
    """Those of random joint positions ``(count, dof)`` of a box beyond a singularity ``(m, dof)``.

    Most are on sides, edges and corners of the box, which reach furthest. On a straight line from
    ``start`` ``(dof,)``; where six joints are free, by the sign of the determinant, whatever is
    between.
    """
    steps = 2 if len(box.free) == 6 else _STEPS
    rng = np.random.default_rng(seed)
    ends = box.sample(count if steps == 2 else count // 4, rng)
    at_bound = rng.uniform(size=ends.shape) < rng.uniform(size=(len(ends), 1))
    ends = np.where(
        at_bound, np.where(rng.uniform(size=ends.shape) < 0.5, box.lower, box.upper), ends
    )
    lines = start + (ends - start)[:, np.newaxis] * np.linspace(0.0, 1.0, steps)[:, np.newaxis]
    determinants = _determinants(robot, lines, box)
    crossed = determinants[:, 1:] * determinants[:, :1] < 0.0
    beyond = crossed.any(axis=1)
    found: FloatArray = lines[beyond, 1 + crossed[beyond].argmax(axis=1)]
    return found


def _branches(robot: Robot, box: JointLimits) -> str:
    """How much of a joint box is beyond a singularity, and which joints lead there."""
    # Six dimensions are the same everywhere: no need to follow them.
    count, steps = (10 * _SAMPLES, 2) if len(box.free) == 6 else (_SAMPLES, _STEPS)
    ends = _sample(box, count)
    start = ends[np.argmax(np.linalg.svd(_scaled_jacobians(robot, ends, box))[1][:, -1])]
    lines = start + (ends - start)[:, np.newaxis] * np.linspace(0.0, 1.0, steps)[:, np.newaxis]
    determinants = _determinants(robot, lines, box)
    products = determinants[:, -1] * determinants[:, 0]
    # NaN: not followed to its end.
    beyond = np.mean(products[~np.isnan(products)] < 0.0)
    leading = []
    for joint in box.free:
        lines = np.repeat(_sample(box, _LINES)[:, np.newaxis], _STEPS, axis=1)
        lines[:, :, joint] = np.linspace(box.lower[joint], box.upper[joint], _STEPS)
        determinants = _determinants(robot, lines, box)
        rows, before = np.nonzero(determinants[:, 1:] * determinants[:, :-1] < 0.0)
        share = len(set(rows.tolist())) / _LINES
        # Less may be rounding at the edge of the box.
        if share >= 0.02:
            first, second = determinants[rows, before], determinants[rows, before + 1]
            step = lines[0, 1, joint] - lines[0, 0, joint]
            crossed = lines[rows, before, joint] + step * first / (first - second)
            low, middle, high = np.round(np.percentile(crossed, [5, 50, 95]), 2) + 0.0
            narrow = high - low < 0.05 * (box.upper[joint] - box.lower[joint])
            where = f"at {middle:g}" if narrow else f"between {low:g} and {high:g}"
            leading.append((share, f"{robot.joint_names[joint]} ({where})"))
    if not beyond and not leading:
        return f"one branch: no singularity between any of {count} joint positions of the box"
    crossed_by = ", ".join(text for _, text in sorted(leading, reverse=True))
    return (
        f"two branches or more: {100 * min(beyond, 1.0 - beyond):.1f} % of the joint box are "
        f"beyond a singularity{crossed_by and f', which is crossed by {crossed_by}'}. Poses there "
        "may have two solutions; a box on one side of it, by --joint-box, is better"
    )


def _determinants(robot: Robot, lines: FloatArray, box: JointLimits) -> FloatArray:
    """Determinants ``(m, k)`` of the Jacobian along lines of joint positions ``(m, k, dof)``.

    In the dimensions in which the end effector moves. Where these are fewer than six they turn
    along a line; their orientation is kept from each position to the next. NaN from where on they
    turn too fast for that.
    """
    count, steps, dof = lines.shape
    jacobians = _scaled_jacobians(robot, lines.reshape(-1, dof), box)
    jacobians = jacobians.reshape(count, steps, 6, len(box.free))
    if len(box.free) == 6:
        return np.asarray(np.linalg.det(jacobians))
    spans = np.linalg.svd(jacobians, full_matrices=False)[0]
    span, found = spans[:, 0], np.empty((count, steps))
    followed = np.ones(count, dtype=bool)
    for step in range(steps):
        # The basis of this span that is nearest to that of the one before.
        left, overlaps, right = np.linalg.svd(np.swapaxes(spans[:, step], 1, 2) @ span)
        span = spans[:, step] @ left @ right
        followed &= overlaps[:, -1] > 0.5
        determinants = np.linalg.det(np.swapaxes(span, 1, 2) @ jacobians[:, step])
        found[:, step] = np.where(followed, determinants, np.nan)
    return found


def _scaled_jacobians(robot: Robot, joint_positions: FloatArray, box: JointLimits) -> FloatArray:
    """``(n, 6, free)`` for half of each joint's interval, lengths in units of about the arm."""
    halves = 0.5 * (box.upper - box.lower)
    jacobians = (robot.forward_kinematics.jacobians(joint_positions) * halves)[:, :, box.free]
    linear, angular = np.linalg.norm(jacobians[:, :3]), np.linalg.norm(jacobians[:, 3:])
    if linear > 0.0 < angular:
        jacobians[:, :3] *= angular / linear
    return jacobians


def _sample(box: JointLimits, count: int) -> FloatArray:
    return box.sample(count, np.random.default_rng(0))

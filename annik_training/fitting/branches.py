"""One branch of solutions, which a network can learn as a function of the pose.

Where a joint box crosses a singularity, some poses have two solutions in it, and a network that
sees both learns neither. The main branch is the one with most of the examples, by the sign of the
Jacobian's determinant. An example on the other branch is left out if the main branch reaches its
pose too, inside the box; otherwise it is the only solution, and stays.
"""

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.solver.ik_solver import CompiledRefinement, refinement_of
from annik_core.solver.refinement import Refinement, reflected_across_singularity
from annik_core.solver.result import RefinementOptions
from annik_training.joint_box import mobility

#: Most refinement steps towards the other solution.
_STEPS = 40


def branch_signs(robot: Robot, joint_positions: FloatArray) -> FloatArray | None:
    """Signs ``(n,)``, +1 or -1, of the Jacobian's determinant at joint positions ``(n, dof)``.

    None for the gantry, which has one branch, and for an arm unless six joints are free: its
    Jacobian has no determinant.
    """
    free = robot.joint_box.free
    if robot.kind != "arm" or len(free) != 6:
        return None
    jacobians = robot.forward_kinematics.jacobians(joint_positions)[:, :, free]
    signs: FloatArray = np.where(np.linalg.det(jacobians) < 0.0, -1.0, 1.0)
    return signs


def single_branch(
    robot: Robot, joint_positions: FloatArray, poses: FloatArray
) -> NDArray[np.bool_]:
    """Examples to learn ``(n,)``: all but second solutions of poses that the main branch reaches.

    The poses ``(n, 7)`` are those of the forward kinematics at joint positions ``(n, dof)``.
    """
    keep = np.ones(len(joint_positions), dtype=bool)
    signs = branch_signs(robot, joint_positions)
    # Of a redundant joint the determinant is zero everywhere.
    if signs is None or mobility(robot).locks:
        return keep
    main = 1.0 if np.sum(signs) >= 0 else -1.0
    refinement = refinement_of(robot, RefinementOptions(max_newton_steps=_STEPS))
    for row in np.flatnonzero(signs != main):
        keep[row] = not _reaches(refinement, robot, main, joint_positions[row], poses[row])
    return keep


def _reaches(
    refinement: Refinement | CompiledRefinement,
    robot: Robot,
    sign: float,
    other: FloatArray,
    pose: FloatArray,
) -> bool:
    """Whether joint positions of the box on the branch of this sign reach a pose."""
    kinematics = robot.forward_kinematics
    beyond = reflected_across_singularity(
        lambda q: kinematics.linearise(q, pose).jacobian, other, robot.joint_box.free
    )
    for start in (beyond, robot.joint_box.centre):
        found = refinement.refine(start, pose)
        signs = branch_signs(robot, found.joint_positions[np.newaxis])
        if found.converged and signs is not None and signs[0] == sign:
            return True
    return False

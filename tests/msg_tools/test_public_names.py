"""What msg_tools offers by name."""

from __future__ import annotations

import pytest
from support.processes import run_python


@pytest.mark.process
def test_a_bag_is_read_without_the_message_packages() -> None:
    script = (
        "import sys\n"
        "from msg_tools import Bag, read_bag, tracking_report\n"
        "print({'geometry_msgs', 'rclpy'} & set(sys.modules))\n"
    )
    result = run_python("-c", script)
    assert result.stdout == "set()\n", result.stderr


def test_a_message_goes_to_the_solver_in_one_line() -> None:
    """And a bad one is refused by the solver, with a reason."""
    pytest.importorskip("geometry_msgs")
    from annik_core.solver.ik_solver import IkSolver
    from msg_tools import (
        joint_state_from_array,
        joint_state_to_array,
        pose_from_array,
        pose_to_array,
    )

    solver = IkSolver.from_file("gantry")
    joint_positions = solver.robot.joint_box.centre
    pose = solver.robot.forward_kinematics.poses(joint_positions[None])[0]
    result = solver.solve(pose_to_array(pose_from_array(pose)))
    assert result.accepted
    assert result.joint_positions == pytest.approx(joint_positions, abs=1e-3)
    names = solver.robot.joint_names
    message = joint_state_from_array(result.joint_positions, names)
    assert joint_state_to_array(message, names) == pytest.approx(result.joint_positions, abs=0)
    pose[0] = float("nan")
    refused = solver.solve(pose_to_array(pose_from_array(pose)))
    assert not refused.accepted
    assert refused.reason

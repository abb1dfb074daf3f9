"""The masses of a URDF's links, by the moments of their weight, which Pinocchio computes too."""

from __future__ import annotations

import numpy as np
import pytest
from support.urdf_texts import TWO_JOINTS

from annik_core.robots.arm_kinematics import gravity_moments
from annik_core.robots.library import load_robot
from annik_core.robots.screw_chain import ScrewChain

pin = pytest.importorskip("pinocchio")
DOWN = np.array([0.0, 0.0, -1.0])


def link(name: str, mass: float | None = None, centre: str = "0 0 0") -> str:
    if mass is None:
        return f"<link name='{name}'/>"
    inertia = "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
    return (
        f"<link name='{name}'><inertial><origin xyz='{centre}'/><mass value='{mass}'/>{inertia}"
        "</inertial></link>"
    )


def joint(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    return (
        f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
        f"<origin xyz='{xyz}' rpy='0.3 0 0.2'/><axis xyz='{axis}'/>"
        "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
    )


#: Three joints, masses between their origins, a camera on the second link and a gripper.
ARM = "".join(
    [
        "<robot name='arm'>",
        link("base", 9.0, "1 2 3"),
        joint("j1", "base", "upper", "0 0 0.2", "0 1 0"),
        link("upper", 4.0, "0.1 0 0.15"),
        joint("j2", "upper", "fore", "0.2 0 0.3", "0 1 0"),
        link("fore", 2.0, "0 0.05 0.1"),
        joint("camera", "fore", "camera", "0 0.025 0.05", "1 0 0", "fixed"),
        link("camera", 0.5),
        joint("j3", "fore", "hand", "0 0.1 0.2", "1 0 0"),
        link("hand", 1.0, "0 0 0.06"),
        joint("finger", "hand", "finger", "0 0 0.03", "0 0 1", "prismatic"),
        link("finger", 0.2),
        joint("end", "hand", "tool", "0 0 0.12", "0 0 1", "fixed"),
        link("tool"),
        "</robot>",
    ]
)


def test_their_weights_turn_the_joints_as_pinocchio_says() -> None:
    robot = load_robot(ARM, end_effector_frame="tool")
    assert robot.masses is not None
    joint_positions = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 3))
    model = pin.buildModelFromXML(ARM)
    order = [model.joints[model.getJointId(name)].idx_q for name in ("j1", "j2", "j3")]
    data, expected = model.createData(), []
    for row in joint_positions:
        configuration = np.zeros(model.nq)
        configuration[order] = row
        expected.append(-pin.computeGeneralizedGravity(model, data, configuration)[order])
    chain = ScrewChain.from_urdf(robot.definition["urdf"])
    moments = gravity_moments(chain, joint_positions, DOWN) @ (9.81 * np.array(robot.masses))
    assert moments == pytest.approx(np.array(expected), abs=1e-9)


def test_are_no_part_of_the_definition() -> None:
    """The same kinematics are the same robot."""
    light = load_robot(ARM.replace("inertial", "other"), end_effector_frame="tool")
    heavy = load_robot(ARM, end_effector_frame="tool")
    assert light.masses is None
    assert light.definition_hash == heavy.definition_hash


@pytest.mark.parametrize("mass", ["", "nan", "-1", "0", "1e300", "heavy"])
def test_without_usable_masses_there_are_none(mass: str) -> None:
    assert load_robot(TWO_JOINTS).masses is None
    inertial = f"<inertial><mass value='{mass}'/></inertial>"
    text = TWO_JOINTS.replace('<link name="b"/>', f'<link name="b">{inertial}</link>')
    assert load_robot(text).masses is None

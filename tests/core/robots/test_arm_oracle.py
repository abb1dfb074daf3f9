"""The packaged arms against their makers' tables.

The oracle is the table of each maker, written out here and evaluated with numpy alone: products of
4x4 matrices, with nothing of annik or Pinocchio in it. The dimensions in ``robots/*.urdf`` were
typed in another form (origins of joints), so a slip in either shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot

QUARTER = np.pi / 2


@dataclass(frozen=True)
class PublishedArm:
    """A table of Denavit-Hartenberg parameters, and where it sits in the robot's own frames.

    Attributes:
        distal: whether the table is in the standard (distal) convention, Rz(theta) Tz(d) Tx(a)
            Rx(alpha), or in Craig's (modified, proximal), Rx(alpha) Tx(a) Rz(theta) Tz(d).
        rows: theta offset [rad], d [m], a [m], alpha [rad] of each joint.
        prismatic: which joints move d, not theta.
        base: from the base frame to frame 0 of the table.
        tool: from the last frame of the table to the end-effector frame.
    """

    distal: bool
    rows: tuple[tuple[float, float, float, float], ...]
    prismatic: frozenset[int] = frozenset()
    base: tuple[tuple[float, ...], ...] = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    tool: tuple[tuple[float, ...], ...] = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Matrices ``(n, 4, 4)`` from the base to the end-effector frame, at ``(n, dof)``."""
        pose = np.broadcast_to(np.array(self.base, dtype=float), (len(q), 4, 4))
        for joint, (offset, d, a, alpha) in enumerate(self.rows):
            moved = q[:, joint]
            if joint in self.prismatic:
                along_z = screw_z(np.full(len(q), offset), d + moved)
            else:
                along_z = screw_z(offset + moved, np.full(len(q), d))
            along_x = screw_x(alpha, a)
            pose = pose @ (along_z @ along_x if self.distal else along_x @ along_z)
        return pose @ np.array(self.tool, dtype=float)


def screw_z(theta: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rz(theta) Tz(d), one for each theta."""
    matrix = np.zeros((len(theta), 4, 4))
    matrix[:, 0, 0] = matrix[:, 1, 1] = np.cos(theta)
    matrix[:, 1, 0] = np.sin(theta)
    matrix[:, 0, 1] = -np.sin(theta)
    matrix[:, 2, 3] = d
    matrix[:, 2, 2] = matrix[:, 3, 3] = 1
    return matrix


def screw_x(alpha: float, a: float) -> np.ndarray:
    """Rx(alpha) Tx(a)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


# UFACTORY prints the root and its decimals, 0.28948866; the root is 2 micrometres shorter.
XARM_UPPER_ARM = np.sqrt(0.2845**2 + 0.0535**2)
XARM_OFFSET = np.arctan(284.5 / 53.5)

PUBLISHED = {
    # Universal Robots, "DH Parameters for calculations of kinematics and dynamics", UR5e. Frame 0
    # is the controller's base; base_link, as in REP-103, is that turned by 180 degrees about z.
    "ur5e": PublishedArm(
        distal=True,
        rows=(
            (0, 0.1625, 0, QUARTER),
            (0, 0, -0.425, 0),
            (0, 0, -0.3922, 0),
            (0, 0.1333, 0, QUARTER),
            (0, 0.0997, 0, -QUARTER),
            (0, 0.0996, 0, 0),
        ),
        base=((-1, 0, 0, 0), (0, -1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
    ),
    # Franka Control Interface documentation, "Denavit-Hartenberg parameters" of the Panda, after
    # Craig; the tool is the table's row "flange".
    "panda": PublishedArm(
        distal=False,
        rows=(
            (0, 0.333, 0, 0),
            (0, 0, 0, -QUARTER),
            (0, 0.316, 0, QUARTER),
            (0, 0, 0.0825, QUARTER),
            (0, 0.384, -0.0825, -QUARTER),
            (0, 0, 0, QUARTER),
            (0, 0, 0.088, QUARTER),
        ),
        tool=((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0.107), (0, 0, 0, 1)),
    ),
    # KUKA, "LBR iiwa 7 R800, LBR iiwa 14 R820 Specification", working envelope of the 14 R820:
    # 360, 420, 400 and 126 mm. Its axes in standard DH.
    "iiwa14": PublishedArm(
        distal=True,
        rows=(
            (0, 0.36, 0, -QUARTER),
            (0, 0, 0, QUARTER),
            (0, 0.42, 0, QUARTER),
            (0, 0, 0, -QUARTER),
            (0, 0.4, 0, -QUARTER),
            (0, 0, 0, QUARTER),
            (0, 0.126, 0, 0),
        ),
    ),
    # Corke and Armstrong-Helouvry, "A search for consensus among model parameters reported for the
    # PUMA 560 robot", ICRA 1994, in the numbers of the Robotics Toolbox, mdl_puma560.
    "puma560": PublishedArm(
        distal=True,
        rows=(
            (0, 0, 0, QUARTER),
            (0, 0, 0.4318, 0),
            (0, 0.15005, 0.0203, -QUARTER),
            (0, 0.4318, 0, QUARTER),
            (0, 0, 0, -QUARTER),
            (0, 0, 0, 0),
        ),
    ),
    # UFACTORY, "Kinematic and Dynamic Parameters of xArm 6", table of standard DH parameters.
    "xarm6": PublishedArm(
        distal=True,
        rows=(
            (0, 0.267, 0, -QUARTER),
            (-XARM_OFFSET, 0, XARM_UPPER_ARM, 0),
            (XARM_OFFSET, 0, 0.0775, -QUARTER),
            (0, 0.3425, 0, QUARTER),
            (0, 0, 0.076, -QUARTER),
            (0, 0.097, 0, 0),
        ),
    ),
    # Adept Cobra s600: 325 and 275 mm of reach (Adept, "Cobra s600/s800 Robot User's Guide"), as
    # the DH table of Corke, Robotics Toolbox for MATLAB, mdl_cobra600.
    "scara": PublishedArm(
        distal=True,
        rows=((0, 0.387, 0.325, 0), (0, 0, 0.275, np.pi), (0, 0, 0, 0), (0, 0, 0, 0)),
        prismatic=frozenset({2}),
    ),
}

# What can be read off a drawing or is printed: joint positions in degrees, position [m], rotation
# matrix, and how many digits of the position there are.
DOWN = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
UPRIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
PRINTED = {
    # Its links in line: 425 + 392.2 forward, 133.3 + 99.6 to the side, 162.5 - 99.7 up.
    "ur5e stretched out": (
        "ur5e",
        (0,) * 6,
        (0.8172, 0.2329, 0.0628),
        ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        1e-9,
    ),
    # Franka's drawing with the DH frames: 0.088 in front, 0.107 below 0.333 + 0.316 + 0.384.
    "panda at zero": ("panda", (0,) * 7, (0.088, 0, 0.926), DOWN, 1e-9),
    # KUKA's working envelope: 1306 mm at its highest.
    "iiwa upright": ("iiwa14", (0,) * 7, (0, 0, 1.306), UPRIGHT, 1e-9),
    # Corke, "Robotics, Vision and Control", chapter on arm kinematics: the pose qn.
    "puma nominal": (
        "puma560",
        (0, 45, 180, 0, 45, 0),
        (0.5963, -0.1501, -0.01435),
        ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        5.1e-5,
    ),
    # xArm user manual, the zero position: x 207, y 0, z 112 mm, roll 180 degrees.
    "xarm at zero": ("xarm6", (0,) * 6, (0.207, 0, 0.112), DOWN, 1e-9),
    # Adept's drawing: a reach of 600 mm.
    "cobra stretched out": ("scara", (0,) * 4, (0.6, 0, 0.387), DOWN, 1e-9),
}


@pytest.fixture(scope="module", params=PUBLISHED)
def arm(request: pytest.FixtureRequest) -> tuple[Robot, PublishedArm]:
    return load_robot(request.param), PUBLISHED[request.param]


def random_joint_positions(robot: Robot, count: int) -> np.ndarray:
    """Anywhere within the joint limits."""
    limits = robot.joint_limits
    rng = np.random.default_rng(0)
    return rng.uniform(limits.lower, limits.upper, (count, robot.dof))


def matrices_of_quaternions(quaternions: np.ndarray) -> np.ndarray:
    """The rotation matrices of unit quaternions x, y, z, w, from the textbook formula."""
    x, y, z, w = quaternions.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def test_poses_are_those_of_the_makers_table(arm: tuple[Robot, PublishedArm]) -> None:
    robot, published = arm
    q = random_joint_positions(robot, 10_000)
    poses = robot.forward_kinematics.poses(q)
    expected = published.poses(q)
    assert np.abs(poses[:, :3] - expected[:, :3, 3]).max() < 1e-9
    assert np.abs(matrices_of_quaternions(poses[:, 3:]) - expected[:, :3, :3]).max() < 1e-9


def test_jacobians_are_the_slopes_of_the_makers_table(arm: tuple[Robot, PublishedArm]) -> None:
    robot, published = arm
    q = random_joint_positions(robot, 200)
    jacobians = robot.forward_kinematics.jacobians(q)
    assert jacobians.shape == (200, 6, robot.dof)
    rotations = published.poses(q)[:, :3, :3]
    step = 1e-5
    for joint in range(robot.dof):
        aside = step * np.eye(robot.dof)[joint]
        slope = (published.poses(q + aside) - published.poses(q - aside)) / (2 * step)
        turning = slope[:, :3, :3] @ rotations.transpose(0, 2, 1)
        angular = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
        columns = np.hstack([slope[:, :3, 3], angular])
        assert np.abs(jacobians[:, :, joint] - columns).max() < 1e-8


@pytest.mark.parametrize("printed", PRINTED)
def test_printed_poses_are_reached(printed: str) -> None:
    name, degrees, position, rotation, tolerance = PRINTED[printed]
    robot = load_robot(name)
    pose = robot.forward_kinematics.poses(np.radians([degrees]))[0]
    assert pose[:3] == pytest.approx(position, abs=tolerance)
    reached = matrices_of_quaternions(pose[np.newaxis, 3:])[0]
    assert reached == pytest.approx(np.array(rotation), abs=1e-9)


def test_the_ur5e_reaches_as_far_as_its_data_sheet_says() -> None:
    """850 mm from the axis of the first joint to the flange."""
    pose = load_robot("ur5e").forward_kinematics.poses(np.zeros((1, 6)))[0]
    assert np.hypot(*pose[:2]) == pytest.approx(0.850, abs=5e-4)


def test_the_iiwa_reaches_as_far_as_its_name_says() -> None:
    """R820: 820 mm from the second to the sixth axis, and 126 mm from there to the flange."""
    sideways = np.radians([[0, 90, 0, 0, 0, 0, 0]])
    pose = load_robot("iiwa14").forward_kinematics.poses(sideways)[0]
    assert pose[:3] == pytest.approx([0.820 + 0.126, 0, 0.360], abs=1e-9)


def test_the_cobra_folds_to_the_radius_of_its_drawing() -> None:
    """162.6 mm, and 210 mm down."""
    robot = load_robot("scara")
    folded = np.array([[0, robot.joint_limits.upper[1], robot.joint_limits.upper[2], 0]])
    pose = robot.forward_kinematics.poses(folded)[0]
    assert np.hypot(*pose[:2]) == pytest.approx(0.1626, abs=5e-5)
    assert pose[2] == pytest.approx(0.387 - 0.210, abs=1e-9)

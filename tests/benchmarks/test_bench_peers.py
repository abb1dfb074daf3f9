"""The solvers that the benchmark compares with, as far as none of them is installed. ROS-free."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_core.robots.errors import InvalidRobotDefinition
from benchmarks.ik.peers import library, pinocchio_clik
from benchmarks.ik.peers.closed_form import chosen_solution, exact_solutions
from benchmarks.ik.peers.peer import PeerUnavailable, imported
from benchmarks.ik.peers.pose_matrix import pose_matrix, roll_pitch_yaw
from benchmarks.ik.peers.problem import IkProblem, free_chain, locked_urdf
from benchmarks.ik.peers.serial_chain import ChainJoint, SerialChain

# An elbow arm with a wrist: axes that are not z, a fixed joint in the midst, a joint without an
# origin, a sliding joint, and, off the chain, a branch.
URDF = """
<robot name="arm">
  <link name="world"/> <link name="base"/> <link name="tip"/> <link name="camera"/>
  <link name="a"/> <link name="b"/> <link name="c"/> <link name="d"/> <link name="e"/>
  <link name="f"/> <link name="g"/> <link name="h"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="base"/><origin xyz="1 2 3" rpy="0.3 0 0"/>
  </joint>
  <joint name="pan" type="continuous">
    <parent link="base"/><child link="a"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="a"/><child link="b"/><origin xyz="0 0.1 0" rpy="0.1 -1.2 0.4"/>
    <axis xyz="0 2 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="plate" type="fixed">
    <parent link="b"/><child link="c"/><origin xyz="0.05 0 0.4" rpy="0 0.5 1"/>
  </joint>
  <joint name="twist" type="revolute">
    <parent link="c"/><child link="d"/><axis xyz="1 -1 0.5"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="d"/><child link="e"/><origin xyz="0 0 0.3" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 0 -1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="e"/><child link="f"/><origin xyz="0.3 0 0" rpy="0 1.5707963267948966 0.7"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.3" effort="1" velocity="1"/>
  </joint>
  <joint name="roll" type="revolute">
    <parent link="f"/><child link="g"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="flex" type="revolute">
    <parent link="g"/><child link="h"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="h"/><child link="tip"/><origin xyz="0 0.02 0.1" rpy="0 0 -0.5"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="h"/><child link="camera"/></joint>
</robot>
"""
JOINTS = ("pan", "lift", "twist", "elbow", "slide", "roll", "flex")
LOCKED = {"twist": 0.4, "slide": 0.12}


def problem(locked: dict[str, float] | None = None) -> IkProblem:
    centre = np.array([0.1, 0.3, -0.2, 1.2, 0.15, 0.5, 0.9])
    reach = np.array([0.4, 0.3, 0.3, 0.4, 0.05, 0.4, 0.3])
    box = np.stack([centre - reach, centre + reach])
    for name, value in (LOCKED if locked is None else locked).items():
        box[:, JOINTS.index(name)] = value
    limits = np.array([[-3.0] * 4 + [0.0, -3.0, -3.0], [3.0] * 4 + [0.3, 3.0, 3.0]])
    return IkProblem(URDF, "base", "tip", JOINTS, *limits, *box)


def samples(of: IkProblem, count: int = 20) -> np.ndarray:
    share = np.random.default_rng(3).uniform(size=(count, len(JOINTS)))
    return of.box_lower + share * (of.box_upper - of.box_lower)


def test_peers_that_are_not_installed_are_left_out_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(of: IkProblem) -> None:
        raise PeerUnavailable("Other", "not installed (pip install other)")

    def broken(of: IkProblem) -> None:
        imported("Broken", "no_such_module_at_all", "pip install broken")

    monkeypatch.setattr(library, "PEERS", {"Other": missing, "Broken": broken})
    assert library.available_peers(problem()) == (
        [],
        [
            ("Other", "not installed (pip install other)"),
            ("Broken", "not installed (pip install broken)"),
        ],
    )


def test_every_peer_is_ready_or_named() -> None:
    ready, skipped = library.available_peers(problem())
    # In this order in both lists, each once.
    names = list(library.PEERS)
    assert sorted([peer.name for peer in ready] + [name for name, _ in skipped]) == sorted(names)
    assert [peer.name for peer in ready] == [name for name in names if name not in dict(skipped)]
    for peer in ready:
        assert peer.version
        assert peer.kind in ("numerical", "closed form")
        assert "\n" not in peer.settings


def test_what_a_package_lacks_is_named(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "half_installed.py").write_text("import something_it_needs\n")
    (tmp_path / "damaged.py").write_text("from math import no_such_function\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PeerUnavailable, match="needs something_it_needs"):
        imported("Half", "half_installed", "pip install half")
    with pytest.raises(PeerUnavailable, match=r"can't be imported: .*no_such_function"):
        imported("Damaged", "damaged", "pip install damaged")


def test_locked_joints_are_fixed_and_the_others_keep_to_the_box() -> None:
    of = problem()
    joints = {
        joint.get("name"): joint
        for joint in ElementTree.fromstring(locked_urdf(of)).findall("joint")
    }
    assert list(joints) == [
        "pan",
        "lift",
        "plate",
        "twist",
        "elbow",
        "slide",
        "roll",
        "flex",
        "flange",
    ]
    fixed = {name for name, joint in joints.items() if joint.get("type") == "fixed"}
    assert fixed == {"plate", "flange", *LOCKED}
    for column in of.free:
        limit = joints[JOINTS[column]].find("limit")
        bounds = [float(limit.get("lower")), float(limit.get("upper"))]
        assert bounds == [of.box_lower[column], of.box_upper[column]]


@pytest.mark.parametrize("locked", [{}, LOCKED, dict.fromkeys(JOINTS, 0.3)])
def test_a_locked_chain_has_the_same_forward_kinematics(locked: dict[str, float]) -> None:
    of = problem(locked)
    whole = SerialChain.from_urdf(URDF, "base", "tip")
    chain = free_chain(of)
    for positions in samples(of):
        assert chain.tip_placement(positions[of.free]) == pytest.approx(
            whole.tip_placement(positions), abs=1e-13
        )
        assert of.with_locked(positions[of.free]) == pytest.approx(positions)


def test_forward_kinematics_is_that_of_pinocchio() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    of = problem()
    chain = SerialChain.from_urdf(URDF, "base", "tip")
    model = pinocchio.buildModelFromXML(locked_urdf(of))
    data = model.createData()
    for positions in samples(of):
        pinocchio.framesForwardKinematics(model, data, positions[of.free])
        placement = data.oMf[model.getFrameId("tip")].homogeneous
        assert chain.tip_placement(positions) == pytest.approx(placement, abs=1e-13)


def test_pinocchio_reaches_targets() -> None:
    pytest.importorskip("pinocchio")
    # All joints but one that makes the arm redundant, which its loop could do too.
    of = problem({"twist": 0.4})
    chain = SerialChain.from_urdf(URDF, "base", "tip")
    peer = pinocchio_clik.make(of)
    reached = 0
    for positions in samples(of, 50):
        target = chain.tip_placement(positions)
        pose = np.concatenate([target[:3, 3], Rotation.from_matrix(target[:3, :3]).as_quat()])
        answer = peer.solve(pose)
        if answer is not None:
            assert answer.shape == (7,)
            assert answer[JOINTS.index("twist")] == 0.4
            assert chain.tip_placement(answer) == pytest.approx(target, abs=1e-6)
            reached += 1
    assert reached >= 45


def test_pinocchio_says_so_when_it_fails() -> None:
    pytest.importorskip("pinocchio")
    assert pinocchio_clik.make(problem()).solve(np.array([9.0, 0, 0, 0, 0, 0, 1])) is None


@pytest.mark.parametrize(
    ("urdf", "base", "tip", "joints", "message"),
    [
        ("<robot", "base", "tip", JOINTS, "not XML"),
        (URDF, "tip", "base", JOINTS, "no chain from tip to base"),
        (URDF, "base", "nowhere", JOINTS, "no chain from base to nowhere"),
        (URDF, "base", "tip", JOINTS[::-1], "not flex, roll"),
        (URDF.replace("prismatic", "planar"), "base", "tip", JOINTS, "slide is planar"),
        (URDF.replace("0 2 0", "0 0 0"), "base", "tip", JOINTS, "lift has no axis"),
        # A circle of links.
        (URDF.replace('parent link="world"', 'parent link="tip"'), "x", "tip", JOINTS, "no chain"),
    ],
)
def test_a_chain_that_is_not_there_is_named(urdf, base, tip, joints, message) -> None:
    right = problem()
    bounds = (right.lower, right.upper, right.box_lower, right.box_upper)
    with pytest.raises(InvalidRobotDefinition, match=message):
        free_chain(IkProblem(urdf, base, tip, joints, *bounds))


@pytest.mark.parametrize("pitch", [0.0, 1.0, -math.pi / 2, math.pi / 2, math.pi / 2 - 1e-9])
def test_angles_of_a_urdf_make_up_the_rotation(pitch: float) -> None:
    rotation = Rotation.from_euler("xyz", [0.7, pitch, -2.1]).as_matrix()
    again = Rotation.from_euler("xyz", roll_pitch_yaw(rotation)).as_matrix()
    assert again == pytest.approx(rotation, abs=1e-14)


def test_a_pose_as_a_matrix() -> None:
    rotation = Rotation.from_euler("xyz", [0.7, -0.4, 2.1])
    matrix = pose_matrix(np.concatenate([[1.0, 2.0, 3.0], rotation.as_quat()]))
    assert matrix[:3, :3] == pytest.approx(rotation.as_matrix(), abs=1e-15)
    assert matrix[:3, 3] == pytest.approx([1.0, 2.0, 3.0])
    assert matrix[3] == pytest.approx([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.6, 0, -0.8), (0.0, 1e-9, -1.0)]
)
def test_z_is_turned_onto_an_axis(axis: tuple[float, float, float]) -> None:
    joint = ChainJoint("joint", False, np.eye(4), np.array(axis, dtype=float))
    turn = joint.z_to_axis[:3, :3]
    assert turn @ [0.0, 0.0, 1.0] == pytest.approx(axis, abs=1e-15)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_closed_form_gives_the_solution_in_the_box_nearest_to_its_centre() -> None:
    of = problem()
    centre, turn = of.free_start, 2.0 * math.pi
    inside, nearer = centre + 0.2, centre - 0.1
    nearest_but_outside = centre.copy()
    nearest_but_outside[4] += 0.35
    found = [nearest_but_outside, inside, nearer + turn, centre + 1.0]
    answer = chosen_solution([solution.tolist() for solution in found], of)
    assert answer[of.free] == pytest.approx(nearer)
    assert answer[JOINTS.index("twist")] == 0.4
    outside = chosen_solution([(centre + 1.0).tolist(), (centre - 0.9 - turn).tolist()], of)
    assert outside[of.free] == pytest.approx(centre - 0.9)


def test_solutions_marked_as_approximate_count_only_if_all_are_and_they_are_right() -> None:
    def forward(positions: list[float]) -> np.ndarray:
        placement = np.eye(4)
        placement[:3, 3] = positions
        return placement

    right, wrong = [1.0, 2.0, 3.0], [1.0, 2.0, 3.1]
    target = forward(right)
    assert exact_solutions([(right, True), (wrong, False)], forward, target) == [wrong]
    assert exact_solutions([(right, True), (wrong, True)], forward, target) == [right]
    assert exact_solutions([(wrong, True)], forward, target) == []

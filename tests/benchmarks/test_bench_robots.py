"""The benchmark of whole robots: its folder, its oracle, and the command on one arm. ROS-free."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from annik_core.robots.library import load_robot
from benchmarks.computed_examples import DESIGNS, FIGURE, SEQUENCE, computed_examples
from benchmarks.ik.peers.serial_chain import SerialChain
from benchmarks.robots.command import page, robots
from benchmarks.robots.folder import ArmFile, NoRobots, arms_of, longest_chain
from benchmarks.robots.oracle import Oracle

BRANCHED = """<robot name="r">
  <joint name="a" type="revolute"><parent link="root"/><child link="one"/></joint>
  <joint name="b" type="fixed"><parent link="one"/><child link="camera"/></joint>
  <joint name="c" type="prismatic"><parent link="one"/><child link="two"/></joint>
  <joint name="d" type="fixed"><parent link="two"/><child link="tip"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def ur5e() -> ArmFile:
    robot = load_robot("ur5e")
    urdf = str(robot.definition["urdf"])
    return ArmFile("ur5e", urdf, robot.base_frame, robot.end_effector_frame)


@pytest.fixture(scope="module")
def oracle(ur5e: ArmFile) -> Oracle:
    return Oracle.of(ur5e)


def test_the_longest_chain_has_most_moving_joints() -> None:
    assert longest_chain(BRANCHED) == ("root", "tip")


def test_an_index_names_the_frames(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / f"{name}.urdf").write_text(BRANCHED)
    (tmp_path / "index.csv").write_text("name,base_frame,end_effector_frame\nsecond,root,camera\n")
    assert [(arm.name, arm.end_effector_frame) for arm in arms_of(tmp_path)] == [
        ("first", "tip"),
        ("second", "camera"),
    ]


def test_a_folder_without_urdfs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NoRobots):
        arms_of(tmp_path)


def test_the_oracle_knows_limits_and_kinematics(oracle: Oracle) -> None:
    robot = load_robot("ur5e")
    positions = oracle.sample(20, np.random.default_rng(1))
    assert oracle.lower == pytest.approx(robot.joint_limits.lower)
    assert oracle.within_limits(positions).all()
    assert not oracle.within_limits(positions + 10.0).any()
    poses = robot.forward_kinematics.poses(positions)
    distances, angles = oracle.errors(positions, poses)
    assert max(distances.max(), angles.max()) < 1e-12


def test_the_oracle_keeps_soft_limits(ur5e: ArmFile, oracle: Oracle) -> None:
    soft = '<safety_controller soft_lower_limit="-1" soft_upper_limit="9"/></joint>'
    first, *others = ur5e.urdf.split("</joint>")
    kept = Oracle.of(replace(ur5e, urdf=first + soft + "</joint>".join(others)))
    assert kept.lower.tolist() == [-1.0, *oracle.lower[1:]]
    assert kept.upper.tolist() == oracle.upper.tolist()


def test_restarts_find_the_eight_solutions_of_a_ur(oracle: Oracle) -> None:
    rng = np.random.default_rng(3)
    home = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    pose = oracle.poses(home[np.newaxis])[0]
    found = oracle.distinct(oracle.refined(oracle.sample(300, rng), pose))
    assert len(found) == 8
    assert np.abs(found - home).max(axis=1).min() < 1e-9


def test_a_short_step_needs_what_it_takes(oracle: Oracle) -> None:
    before = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    after = before + 1e-3
    pose = oracle.poses(after[np.newaxis])[0]
    assert oracle.needed(before, after, pose) == pytest.approx(1e-3, rel=0.02)
    assert oracle.continues(before, pose)


def test_at_a_limit_the_other_joints_must_do_the_rest(oracle: Oracle) -> None:
    """Of two joints about one axis: where one stands, the other moves twice as far."""
    joint, fixed = oracle.chain.joints[0], replace(oracle.chain.joints[0], placement=np.eye(4))
    pair = SerialChain((joint, fixed), oracle.chain.tip)
    free = Oracle(pair, np.full(2, -1.0), np.full(2, 1.0))
    before = np.array([0.0, 0.999])
    pose = free.poses(before[np.newaxis] + np.array([0.1, 0.0]))[0]
    wide = replace(free, upper=np.full(2, 2.0))
    assert wide.needed(before, before + 0.05, pose) == pytest.approx(0.05, rel=0.02)
    assert free.needed(before, before + np.array([0.1, 0.0]), pose) == pytest.approx(
        0.099, rel=0.02
    )


def test_the_command_measures_a_folder(ur5e: ArmFile, tmp_path: Path) -> None:
    (tmp_path / "ur5e.urdf").write_text(ur5e.urdf, encoding="utf-8")
    (tmp_path / "bad.urdf").write_text(BRANCHED, encoding="utf-8")
    amounts = {"poses": 10, "recall-poses": 3, "restarts": 100, "paths": 2, "points": 10}
    options = [f"--{name}={amount}" for name, amount in amounts.items()]
    result = CliRunner().invoke(robots, [str(tmp_path), "--out", str(tmp_path), *options])
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "robots.json").read_text(encoding="utf-8"))
    assert set(data["refused"]) == {"bad"}
    (arm,) = data["arms"]
    assert arm["joints"] == "RRRRRR"
    assert arm["answered"] == arm["right"] == arm["recall"] == 1.0
    assert arm["solutions"] > 2
    assert arm["paths"]["wrong"] == arm["paths"]["large_steps"] == 0
    assert (tmp_path / "robots.md").read_text(encoding="utf-8") == page(data)


def test_computed_examples_of_each_design_are_searched(tmp_path: Path) -> None:
    amounts = ["--poses=5", "--recall-poses=1"]
    command = ["--quick", "--out", str(tmp_path), *amounts]
    result = CliRunner().invoke(computed_examples, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = [line.split(" | ") for line in result.output.splitlines() if line.startswith("| ")][2:]
    assert [row[0].removeprefix("| ") for row in rows[::2]] == [SEQUENCE, *DESIGNS]
    assert all(float(row[3]) > 80.0 for row in rows)
    few, many = (float(row[4].removesuffix(" |")) for row in rows[:2])
    assert many < few
    assert (tmp_path / FIGURE).read_bytes().startswith(b"\x89PNG")

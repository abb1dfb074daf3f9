"""The model file of an arm: it carries the robot; what is altered in it is refused. ROS-free."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from support.six_joint_arm import BASE, BOX, FLANGE, URDF

from annik_core.errors import RobotMismatch
from annik_core.installation import model_path, packaged_models
from annik_core.model.artifact import load_model
from annik_core.model.errors import InvalidMetadata, ModelNotFound
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.safety import IkStatus
from annik_core.solver.ik_solver import IkSolver


@pytest.fixture(scope="module")
def known() -> Robot:
    """The arm as its URDF gives it."""
    return load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE, joint_box={**BOX})


def altered(source: Path, path: Path, **entries: Callable[[Any], Any]) -> Path:
    """The model with entries of its metadata changed."""
    model = onnx.load(source)
    for prop in model.metadata_props:
        change = entries.pop(prop.key.removeprefix("annik."), None)
        if change is not None:
            prop.value = json.dumps(change(json.loads(prop.value)))
    assert not entries
    onnx.save(model, path)
    return path


def test_the_robot_comes_back_from_the_model_file(arm_model: Path, known: Robot) -> None:
    """The same hash, kinematics to the last bit, and nothing beside the file is needed."""
    artifact = load_model(arm_model, expected_robot=known)
    robot = artifact.robot
    assert robot.definition_hash == known.definition_hash == artifact.metadata.robot_hash
    assert robot.joint_limits.upper.tolist() == [2.9] * 6
    joint_positions = np.random.default_rng(0).uniform(-1.0, 1.0, (10, 6))
    assert np.array_equal(
        robot.forward_kinematics.poses(joint_positions),
        known.forward_kinematics.poses(joint_positions),
    )


def test_a_barely_trained_model_solves_exactly(arm_model: Path, known: Robot) -> None:
    """Refined; no solution leaves the joint box."""
    solver = IkSolver(load_model(arm_model))
    share = np.random.default_rng(0).uniform(0.2, 0.8, (50, 6))
    box = known.joint_box
    wanted = box.lower + share * (box.upper - box.lower)
    for joint_positions, pose in zip(wanted, known.forward_kinematics.poses(wanted), strict=True):
        result = solver.solve(pose)
        assert result.status is IkStatus.SUCCESS
        assert result.joint_positions == pytest.approx(joint_positions, abs=1e-5)
        assert box.contains(result.joint_positions)


def test_another_box_is_another_robot(arm_model: Path) -> None:
    other = load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE)
    with pytest.raises(RobotMismatch) as caught:
        load_model(arm_model, expected_robot=other)
    assert caught.value.found.startswith("bench_arm ")


def _longer(definition: dict[str, Any]) -> dict[str, Any]:
    """The upper arm by one millimetre."""
    return {**definition, "urdf": definition["urdf"].replace('"0.4 0.0 0.0"', '"0.401 0.0 0.0"')}


def _with_urdf(change: Callable[[str], str]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda definition: {**definition, "urdf": change(definition["urdf"])}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (_longer, "robot_hash"),
        (_with_urdf(lambda urdf: urdf.replace('lower="-2.9"', 'lower="-2.8"', 1)), "robot_hash"),
        (_with_urdf(lambda urdf: urdf.replace("elbow", "knee")), "joint_box' names 'elbow'"),
        (_with_urdf(lambda urdf: urdf[:-9]), "not XML"),
        (
            _with_urdf(lambda urdf: urdf.replace('type="revolute"', 'type="floating"', 1)),
            "floating",
        ),
        (_with_urdf(lambda _: ""), "not XML"),
        (lambda definition: {**definition, "urdf": None}, "'urdf' is missing"),
        (lambda definition: {**definition, "urdf": {"file": "x"}}, "'urdf' is missing"),
        (
            lambda definition: {**definition, "urdf_file": "/etc/passwd"},
            "is not an entry of an arm",
        ),
        (lambda definition: {**definition, "end_effector_frame": "palm"}, "is not a link"),
        (lambda definition: {**definition, "kind": "gantry"}, "robot"),
    ],
)
def test_a_tampered_robot_is_refused(
    arm_model: Path, tmp_path: Path, change: Callable[[Any], Any], problem: str
) -> None:
    """By the hash, or before that where the definition is no arm any more."""
    path = altered(arm_model, tmp_path / "tampered.onnx", robot=change)
    assert path.read_bytes() != arm_model.read_bytes()
    with pytest.raises(InvalidMetadata) as caught:
        load_model(path)
    assert caught.value.path == path
    assert problem == caught.value.key or problem in caught.value.problem


def test_a_tampered_robot_with_its_own_hash_is_another_robot(
    arm_model: Path, tmp_path: Path, known: Robot
) -> None:
    """The hash in the file agrees; it is not the hash of the robot that the caller expects."""
    definition = _longer(dict(known.definition))
    assert definition != dict(known.definition)
    forged = load_robot(
        definition["urdf"], base_frame=BASE, end_effector_frame=FLANGE, joint_box={**BOX}
    )
    path = altered(
        arm_model,
        tmp_path / "forged.onnx",
        robot=_longer,
        robot_hash=lambda _: forged.definition_hash,
    )
    with pytest.raises(RobotMismatch):
        load_model(path, expected_robot=known)


def test_a_packaged_model_is_known_by_its_name_and_all_else_is_a_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a file of that name is in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("gantry").write_text("exists", encoding="utf-8")
    assert "gantry" in packaged_models()
    for name in packaged_models():
        assert model_path(name).name == f"{name}.onnx"
        assert load_model(name).robot.name == name
    assert model_path("octopus") == Path("octopus")
    assert model_path("./gantry") == Path("gantry")
    with pytest.raises(ModelNotFound) as caught:
        load_model("octopus")
    assert caught.value.path == Path("octopus")

"""Evaluation of a whole robot, against a direct computation. ROS-free."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from support.six_joint_arm import BASE, FLANGE, URDF

from annik_core.robots.library import load_robot
from annik_training.defaults import defaults_of
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.evaluation import network_errors
from annik_training.training import train

SHARED = Path(__file__).parents[3] / "shared" / "robots"


def test_what_is_not_answered_or_not_right_is_counted() -> None:
    """Poses that the arm can't reach have no solution; guesses beyond all bounds do no harm."""
    robot = load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE)
    unseen = random_dataset(robot, robot.joint_box, 40, seed=5)
    far = unseen.poses.copy()
    far[:10, 2] += 5.0
    object.__setattr__(unseen, "poses", far)
    errors = network_errors(lambda poses: np.full((len(poses), 6), 1e3), unseen)
    evaluation = errors.summary().whole_robot
    assert errors.refined is None
    assert evaluation is not None
    assert errors.unsolved is not None
    assert errors.unsolved[:10].all()
    assert not errors.unsolved[10:].any()
    assert evaluation.answered == evaluation.right == pytest.approx(0.75)


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/robots is not beside this checkout")
@pytest.mark.parametrize("name", ["kuka_kr210", "kinova_gen3", "px150", "stretch3"])
def test_arms_of_other_makers_need_nothing_but_their_frames(name: str, tmp_path: Path) -> None:
    rows = {row["name"]: row for row in csv.DictReader((SHARED / "index.csv").open())}
    frames = {key: rows[name][key] for key in ("base_frame", "end_effector_frame")}
    robot = load_robot(SHARED / f"{name}.urdf", **frames)
    usual = defaults_of(robot)
    dataset = generate_dataset(robot, usual.design, usual.size, seed=0)
    trained = train(dataset, tmp_path / "m.onnx", evaluation_poses=200)
    assert trained.evaluation.whole_robot is not None
    assert trained.evaluation.whole_robot.right >= 0.995
    assert trained.path.stat().st_size < 3e6

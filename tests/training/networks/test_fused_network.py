"""The network as it is exported is the network as it was trained, of any arm. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_training.designs.sampling import compute_dataset, compute_random_dataset
from annik_training.fitting.fit import FittedNetwork, fit
from annik_training.fitting.options import FitOptions
from annik_training.networks.network import FusedNetwork, for_export

pytestmark = pytest.mark.usefixtures("one_thread")

#: Locked joints, and boxes in which parts of the pose do not change but for rounding.
EACH_ARM = pytest.mark.parametrize(
    ("name", "joint_box"),
    [
        ("ur5e", None),
        ("panda", None),
        ("scara", None),
        ("scara", {"joint1": [0.3, 0.3], "joint2": [1.0, 1.0], "joint4": [0.2, 0.2]}),
    ],
    ids=["ur5e", "panda", "scara", "scara_up_and_down"],
)


def fitted(
    name: str, joint_box: dict[str, list[float]] | None, linear_path: bool
) -> FittedNetwork:
    robot = load_robot(name, joint_box=joint_box)
    options = FitOptions(
        hidden_units=(6, 5),
        restarts=1,
        held_out_fraction=0.0,
        max_evaluations=40,
        linear_path=linear_path,
        slope_weight=3.0,
        optimiser="lbfgs",
    )
    return fit(compute_dataset(robot, "sobol", 32, seed=0), options)


def with_noise(poses: FloatArray) -> FloatArray:
    """As a camera or single precision would give them."""
    noisy = poses + np.random.default_rng(0).uniform(-1e-7, 1e-7, poses.shape)
    noisy[:, 3:] /= np.linalg.norm(noisy[:, 3:], axis=1, keepdims=True)
    return noisy


@EACH_ARM
@pytest.mark.parametrize("linear_path", [False, True])
def test_fused_it_answers_the_same(
    name: str, joint_box: dict[str, list[float]] | None, linear_path: bool
) -> None:
    network = fitted(name, joint_box, linear_path).network
    fused = for_export(network)
    assert isinstance(fused, FusedNetwork)
    robot = load_robot(name, joint_box=joint_box)
    poses = with_noise(compute_random_dataset(robot, robot.joint_box, 100, seed=1).poses)
    with torch.no_grad():
        answers = fused(torch.from_numpy(poses)).numpy()
    assert answers == pytest.approx(network.joint_positions(poses), abs=1e-12, rel=0)


@EACH_ARM
def test_a_pose_off_by_a_little_is_answered_nearly_the_same(
    name: str, joint_box: dict[str, list[float]] | None
) -> None:
    """Rounding of what is constant on this arm must not be taken for a signal."""
    network = fitted(name, joint_box, True).network
    robot = load_robot(name, joint_box=joint_box)
    poses = compute_random_dataset(robot, robot.joint_box, 100, seed=1).poses
    moved = network.joint_positions(with_noise(poses)) - network.joint_positions(poses)
    assert np.abs(moved).max() < 1e-5


def test_the_gantry_is_exported_as_it_is(gantry: object) -> None:
    network = fit(
        compute_dataset(gantry, "thirty_phase", 3, seed=0),
        FitOptions(hidden_units=(3,), restarts=1, max_evaluations=1),
    ).network
    assert for_export(network) is network

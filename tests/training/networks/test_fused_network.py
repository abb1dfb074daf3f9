"""The network as it is exported is the network as it was trained, of any robot. ROS-free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from annik_core.model.graph import nodes_after
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.fitting.fit import FittedNetwork, fit
from annik_training.fitting.options import FitOptions
from annik_training.networks.network import InverseKinematicsNetwork

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
        sobolev_weight=3.0,
        optimiser="lbfgs",
    )
    return fit(generate_dataset(robot, "sobol", 32, seed=0), options)


def fused(network: InverseKinematicsNetwork, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Joint positions and features of the fused network."""
    with torch.no_grad():
        joint_positions, features = network.fused()(torch.from_numpy(poses))
    return joint_positions.numpy(), features.numpy()


def with_noise(poses: FloatArray) -> FloatArray:
    """As a camera or single precision would give them."""
    noisy = poses + np.random.default_rng(0).uniform(-1e-7, 1e-7, poses.shape)
    noisy[:, 3:] /= np.linalg.norm(noisy[:, 3:], axis=1, keepdims=True)
    return noisy


@EACH_ARM
@pytest.mark.parametrize("linear_path", [False, True])
def test_a_fused_arms_network_computes_the_same(
    name: str, joint_box: dict[str, list[float]] | None, linear_path: bool
) -> None:
    network = fitted(name, joint_box, linear_path).network
    robot = load_robot(name, joint_box=joint_box)
    poses = with_noise(random_dataset(robot, robot.joint_box, 100, seed=1).poses)
    joint_positions, features = fused(network, poses)
    assert joint_positions == pytest.approx(network.joint_positions(poses), abs=1e-12, rel=0)
    assert features.shape == (100, 13)


@pytest.mark.parametrize("linear_path", [False, True])
@pytest.mark.parametrize("hidden_units", [(5,), (5, 4)])
def test_the_fused_gantrys_network_computes_the_same(
    gantry: Robot, hidden_units: tuple[int, ...], linear_path: bool
) -> None:
    """Also on the gimbal edge, where some of these poses are. Its features are the angles."""
    options = FitOptions(
        hidden_units=hidden_units, restarts=1, max_evaluations=3, linear_path=linear_path
    )
    dataset = generate_dataset(gantry, "thirty_phase", 3, seed=0)
    network = fit(dataset, options).network
    with torch.no_grad():
        # A linear path fits the gantry exactly and leaves the hidden layers without effect.
        network.network.output.weight.add_(0.01)
    joint_positions, features = fused(network, dataset.poses)
    assert joint_positions == pytest.approx(
        network.joint_positions(dataset.poses), abs=1e-12, rel=0
    )
    with torch.no_grad():
        assert np.array_equal(features, network.encoding(torch.from_numpy(dataset.poses)))


@pytest.mark.parametrize("linear_path", [False, True])
@pytest.mark.parametrize("name", ["gantry", "scara"])
def test_the_exported_graph_ends_in_layers_behind_a_tensor_named_features(
    name: str, linear_path: bool
) -> None:
    """For both encodings: no scaling is left, and only ``joint_positions`` is an output."""
    options = FitOptions(
        hidden_units=(4, 3), restarts=1, max_evaluations=2, linear_path=linear_path
    )
    design, size = ("thirty_phase", 3) if name == "gantry" else ("sobol", 32)
    network = fit(generate_dataset(load_robot(name), design, size, seed=0), options).network
    graph = network.as_onnx()
    assert [output.name for output in graph.graph.output] == ["joint_positions"]
    operators = [node.op_type for node in nodes_after("features", graph, Path(name))]
    assert operators == ["Gemm", "Tanh", "Gemm", "Tanh", "Gemm"] + ["Gemm"] * linear_path
    (shape,) = (
        [dimension.dim_value for dimension in value.type.tensor_type.shape.dim]
        for value in graph.graph.value_info
        if value.name == "features"
    )
    assert shape == [0, 6 if name == "gantry" else 13]


@EACH_ARM
def test_a_small_change_of_the_pose_is_a_small_change_of_the_joints(
    name: str, joint_box: dict[str, list[float]] | None
) -> None:
    """Rounding of what is constant on this arm must not be taken for a signal."""
    network = fitted(name, joint_box, True).network
    robot = load_robot(name, joint_box=joint_box)
    poses = random_dataset(robot, robot.joint_box, 100, seed=1).poses
    moved = network.joint_positions(with_noise(poses)) - network.joint_positions(poses)
    assert np.abs(moved).max() < 1e-5

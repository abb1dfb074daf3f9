"""Corrections of an arm, drawn at random: as large as those of real arms, and of every kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    ErrorBound,
    JointHarmonics,
    JointNetworks,
    PoseHarmonics,
    PoseNetwork,
)
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot

HIDDEN = 4


def drawn_corrections(robot: Robot, seed: int) -> ArmCorrections:
    """Millimetres and tenths of degrees; 0.2 mm and 0.02 degrees of the end effector."""
    rng = np.random.default_rng(seed)
    box, dof = robot.joint_box, robot.dof
    half = 0.5 * (box.upper - box.lower)
    scale = (box.centre, np.where(half > 0.0, half, 1.0))
    turns = Rotation.from_rotvec(rng.normal(size=(dof + 1, 3)) * 5e-3)
    shifts = rng.normal(size=(dof + 1, 3)) * 1e-3
    units = np.where(np.array(robot.joint_types) == "revolute", 3e-3, 3e-4)[:, None]
    coefficients = rng.normal(size=(2, 1 + dof + dof * (dof + 1) // 2)) * 0.1
    coefficients[:, 0] -= 8.0
    # Not along the axis of rotation, so that the order of shift and turn matters.
    motions = np.array([[2e-4], [2e-4], [-2e-4], [3e-4], [-3e-4], [3e-4]])
    gravity = np.array([0.6, 0.0, -0.8])
    more = np.random.default_rng([seed, 1])
    harmonics = 0.3 * units * more.normal(size=(2, dof, 3))
    return ArmCorrections(
        np.concatenate([shifts, turns.as_quat(canonical=True)], axis=1),
        JointNetworks(*scale, *rng.normal(size=(2, dof, HIDDEN)), units * rng.normal(size=HIDDEN)),
        PoseNetwork(
            *scale,
            rng.normal(size=(HIDDEN, dof)),
            rng.normal(size=HIDDEN),
            motions * rng.normal(size=HIDDEN),
        ),
        ErrorBound(*scale, coefficients),
        {"examples": 3, "parts": ["geometry"]},
        JointHarmonics(np.ones(dof), *harmonics),
        Deflection(more.normal(size=(dof, dof)) * 2e-3, gravity),
        PoseHarmonics(
            more.integers(-1, 2, (5, dof)).astype(np.float64),
            *(0.1 * motions * more.normal(size=(2, 1, 5))),
        ),
    )


def identity_corrections(robot: Robot) -> ArmCorrections:
    """Nothing is corrected, by all means."""
    drawn = drawn_corrections(robot, 0)
    joints, pose = drawn.joint_networks, drawn.pose_network
    assert joints is not None and pose is not None
    return ArmCorrections(
        np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (robot.dof + 1, 1)),
        replace(joints, output_weights=np.zeros_like(joints.output_weights)),
        replace(pose, output_weights=np.zeros_like(pose.output_weights)),
        joint_harmonics=JointHarmonics(np.ones(robot.dof), *np.zeros((2, robot.dof, 3))),
        deflection=Deflection(np.zeros((robot.dof, robot.dof)), np.array([0.0, 0.0, -1.0])),
        pose_harmonics=PoseHarmonics(np.ones((2, robot.dof)), *np.zeros((2, 6, 2))),
    )


def corrected(robot: Robot, corrections: ArmCorrections) -> Robot:
    """The robot with these corrections in its definition."""
    definition = {**robot.definition, "corrections": corrections.to_dict()}
    return robot_from_definition(definition, "corrected")

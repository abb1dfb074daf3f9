"""A model file of a UR5e that was learned, without the learning: its corrections are made up."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import onnx

from annik_core.installation import model_path
from annik_core.model.artifact import load_model
from annik_core.robots.corrections import ArmCorrections, ErrorBound
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot

#: What it states at the middle of the working box [m], [rad].
EXPECTED_ERROR, EXPECTED_ANGLE = 5e-5, 1e-4


def learned_robot() -> Robot:
    """A UR5e with half a millimetre more in each link, and a bound that grows from the middle."""
    nominal = load_model("ur5e").robot
    placements = np.tile([5e-4, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (nominal.dof + 1, 1))
    box = nominal.joint_box
    coefficients = np.zeros((2, 28))
    coefficients[:, 0] = np.log([EXPECTED_ERROR, EXPECTED_ANGLE])
    # The square of the first joint's position in the box.
    coefficients[:, 7] = 1.0
    corrections = ArmCorrections(
        placements,
        error_bound=ErrorBound(box.centre, 0.5 * (box.upper - box.lower), coefficients),
        provenance={"examples": 102},
    )
    definition = {**nominal.definition, "corrections": corrections.to_dict()}
    return robot_from_definition(definition, "the test's")


def write_learned_model(path: Path) -> Robot:
    """The packaged network, for the learned robot."""
    robot = learned_robot()
    model = onnx.load(model_path("ur5e"))
    changed = {
        "annik.robot": copy.deepcopy(dict(robot.definition)),
        "annik.robot_hash": robot.definition_hash,
    }
    for entry in model.metadata_props:
        if entry.key in changed:
            entry.value = json.dumps(changed[entry.key])
    onnx.save(model, path)
    return robot

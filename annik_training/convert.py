"""Convert a model file of format 1 to the format of today: same weights, metadata and references.

Format 1 had no named tensor where the encoding ends, and the gantry's network was not fused.
"""

import json
from pathlib import Path

import numpy as np
import torch

from annik_core.model.artifact import read_model_file
from annik_core.model.errors import ModelError
from annik_core.model.graph import (
    FEATURES_NAME,
    INPUT_NAME,
    OUTPUT_NAME,
    check_graph,
    graph_properties,
    parsed_graph,
    tensor_values,
)
from annik_core.model.metadata import CONVERTIBLE_VERSION, FORMAT_VERSION, ModelMetadata
from annik_core.model.session import make_session
from annik_core.pose import FloatArray
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.designs.sampling import random_dataset
from annik_training.export import PROOF_POSES, write_model
from annik_training.fitting.problem import InverseKinematicsSystem
from annik_training.networks.encoding import PositionRotationMatrix
from annik_training.networks.network import (
    FusedNetwork,
    InverseKinematicsNetwork,
    ScaledNetwork,
    Scaling,
    linear_layer,
)


class NotConvertible(ModelError):
    """A model file is not one of format 1 as annik wrote it."""


#: Largest difference between the old and the new file [rad or m].
CONVERSION_TOLERANCE = 1e-12


def convert_model(old: Path, new: Path) -> ModelMetadata:
    """Write a model file of format 1 in the format of today; returns the new metadata.

    Raises:
        NotConvertible: if the old file is of another format, or is not as annik wrote it.
        ModelError: if the old file can't be used, or its weights were altered.
        ExportMismatch: if the files' joint positions differ by more than
            :data:`CONVERSION_TOLERANCE`. Nothing is written then.
        NotWritable: if the new file can't be written.
    """
    content = read_model_file(old)
    graph = parsed_graph(content, old)
    check_graph(graph, old)
    properties = graph_properties(graph, old)
    version = properties.get("annik.format_version")
    if version != json.dumps(CONVERTIBLE_VERSION):
        raise NotConvertible(
            old,
            f"format version {version}; only files of format {CONVERTIBLE_VERSION} are converted",
            "use it as it is, or train it again with 'annik train'",
        )
    changes = {"format_version": FORMAT_VERSION, "features": FEATURES_NAME}
    properties |= {f"annik.{key}": json.dumps(value) for key, value in changes.items()}
    metadata = ModelMetadata.from_properties(properties, old)
    robot = robot_from_definition(metadata.robot, f"in {old}")
    weights = {
        tensor.name: torch.from_numpy(tensor_values(tensor, old).copy())
        for tensor in graph.graph.initializer
    }
    try:
        network = _network(weights, metadata, robot)
    # KeyError: a weight is missing. RuntimeError: one has another size.
    except (KeyError, RuntimeError) as error:
        raise NotConvertible(
            old, "its weights are not named as annik names them", "train it again"
        ) from error
    poses = _proof_poses(robot, metadata)
    expected = make_session(content, old).run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
    write_model(network.as_onnx(), metadata, new, poses, expected, CONVERSION_TOLERANCE)
    return metadata


def _network(
    weights: dict[str, torch.Tensor], metadata: ModelMetadata, robot: Robot
) -> FusedNetwork | InverseKinematicsNetwork:
    """The network of a file of format 1, by the names of its weights."""
    encoding = InverseKinematicsSystem(robot).encoding
    if isinstance(encoding, PositionRotationMatrix):
        others = [f"others.{number}" for number in range(len(metadata.hidden_units) - 1)]
        first, *layers, output = (
            linear_layer(weights[f"{name}.weight"], weights[f"{name}.bias"])
            for name in ("first", *others, "output")
        )
        linear_path = None
        if "linear_path.weight" in weights:
            linear_path = linear_layer(weights["linear_path.weight"], weights["linear_path.bias"])
        return FusedNetwork(encoding, [first, *layers], output, linear_path)
    prefix = "network."
    network = ScaledNetwork(
        metadata.hidden_units,
        *(Scaling(np.zeros(size), np.ones(size)) for size in (encoding.features, robot.dof)),
        linear_path=f"{prefix}linear_path.weight" in weights,
    )
    network.load_state_dict(
        {
            name.removeprefix(prefix): weight
            for name, weight in weights.items()
            if name.startswith(prefix)
        }
    )
    return InverseKinematicsNetwork(encoding, network)


def _proof_poses(robot: Robot, metadata: ModelMetadata) -> FloatArray:
    random = random_dataset(robot, robot.joint_box, PROOF_POSES, metadata.seed).poses
    corners = np.stack([robot.joint_box.lower, robot.joint_box.upper])
    return np.concatenate(
        [random, robot.forward_kinematics.poses(corners), metadata.reference_poses]
    )

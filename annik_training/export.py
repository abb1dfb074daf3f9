"""Write a trained network as a model file, after proving that the file computes the same."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import torch

from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_core.installation import VERSION
from annik_core.model.artifact import INPUT_NAME, OUTPUT_NAME, checked_model, make_session
from annik_core.model.errors import ArtifactError
from annik_core.model.metadata import FORMAT_VERSION, ModelMetadata
from annik_core.pose import FloatArray
from annik_training.designs.sampling import compute_random_dataset
from annik_training.evaluation import Evaluation
from annik_training.fitting.fit import FittedNetwork
from annik_training.networks.network import InverseKinematicsNetwork, for_export


class ExportMismatch(ArtifactError):
    """The exported graph does not compute what the trained network computes."""

    def __init__(self, path: Path, difference: float, tolerance: float) -> None:
        self.difference = difference
        self.tolerance = tolerance
        super().__init__(
            path,
            f"exported and trained network differ by {difference:.3g}, more than {tolerance:g}",
            "nothing was written; report this with your onnxruntime and torch versions",
        )


#: Largest difference between exported and trained network [rad or m].
EXPORT_TOLERANCE = 1e-9
#: ONNX operator set: the newest that onnxruntime 1.18 knows whole.
OPSET = 20
_REFERENCE_POSES = 8
_PROOF_POSES = 257


def export_model(fitted: FittedNetwork, evaluation: Evaluation, path: Path) -> ModelMetadata:
    """Write a model file; an existing one is replaced only by a proven new one.

    Args:
        fitted: the network and how it came about.
        evaluation: its errors on unseen poses, which the file carries.
        path: the ``.onnx`` file.

    Returns:
        The metadata that was written.

    Raises:
        ExportMismatch: if onnxruntime's answers differ from the network's by more than
            :data:`EXPORT_TOLERANCE`, one pose at a time or in a batch. Nothing is written then.
        ArtifactError: if a node would refuse the file. Nothing is written then either.
        NotWritable: if the file can't be written.
    """
    model = to_onnx(fitted.network)
    metadata = _metadata(fitted, evaluation)
    onnx.helper.set_model_props(model, metadata.to_properties())
    model.producer_name = "annik"
    model.producer_version = VERSION
    onnx.checker.check_model(model, full_check=True)
    content = model.SerializeToString(deterministic=True)
    robot = fitted.dataset.robot
    proof = compute_random_dataset(robot, robot.joint_box, _PROOF_POSES, fitted.options.seed)
    edge = fitted.dataset.poses
    prove_export(fitted.network, content, np.concatenate([proof.poses, edge]), path)
    # What a node would refuse is not worth writing.
    checked_model(content, path)
    ensure_writable_folder(path.parent)
    write_files_atomically(path.parent, {path.name: content})
    return metadata


def to_onnx(network: InverseKinematicsNetwork) -> onnx.ModelProto:
    """The ONNX graph of a network: input ``pose`` (n, 7), output ``joint_positions`` (n, dof)."""
    example = torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 2, dtype=torch.float64)
    module = for_export(network).eval()
    with warnings.catch_warnings(), _quiet_exporter():
        # The exporter warns of its own deprecations, which no caller can act on.
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            module,
            (example,),
            input_names=[INPUT_NAME],
            output_names=[OUTPUT_NAME],
            dynamic_shapes=({0: torch.export.Dim("n")},),
            opset_version=OPSET,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
    assert program is not None
    model: onnx.ModelProto = program.model_proto
    del model.metadata_props[:]
    for node in model.graph.node:
        # Traces of the exporter: source paths and stack frames, which say nothing to a user.
        del node.metadata_props[:]
        node.doc_string = ""
    for value in [*model.graph.value_info, *model.graph.input, *model.graph.output]:
        del value.metadata_props[:]
    del model.graph.metadata_props[:]
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Keep the exporter from warning that torchvision, which annik does not use, is missing."""
    logger = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


def prove_export(
    network: InverseKinematicsNetwork, content: bytes, poses: FloatArray, path: Path
) -> None:
    """Run an exported graph and compare it with the network it came from.

    Args:
        network: the trained network.
        content: the serialised graph.
        poses: ``(n, 7)`` to compare on, all at once and the first of them one at a time.
        path: what to call the file in an error.

    Raises:
        ExportMismatch: if an answer differs by more than :data:`EXPORT_TOLERANCE`, or is NaN.
    """
    session = make_session(content, path)
    expected = network.joint_positions(poses)
    in_batch = session.run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
    alone = np.concatenate(
        [session.run([OUTPUT_NAME], {INPUT_NAME: pose[np.newaxis]})[0] for pose in poses[:16]]
    )
    difference = max(
        float(np.abs(in_batch - expected).max()), float(np.abs(alone - expected[:16]).max())
    )
    if not difference <= EXPORT_TOLERANCE:
        raise ExportMismatch(path, difference, EXPORT_TOLERANCE)


def _metadata(fitted: FittedNetwork, evaluation: Evaluation) -> ModelMetadata:
    dataset = fitted.dataset
    robot = dataset.robot
    references = compute_random_dataset(
        robot, robot.joint_box, _REFERENCE_POSES, fitted.options.seed + 1
    ).poses
    return ModelMetadata(
        format_version=FORMAT_VERSION,
        package_version=VERSION,
        robot=dict(robot.definition),
        robot_hash=robot.definition_hash,
        joint_names=list(robot.joint_names),
        base_frame=robot.base_frame,
        end_effector_frame=robot.end_effector_frame,
        joint_box_lower=robot.joint_box.lower.tolist(),
        joint_box_upper=robot.joint_box.upper.tolist(),
        encoding=fitted.network.encoding.name,
        hidden_units=list(fitted.options.hidden_units),
        design=dataset.design,
        design_options=dict(dataset.design_options),
        examples=len(dataset),
        held_out_examples=len(fitted.held_out),
        dataset_hash=dataset.content_hash,
        seed=fitted.options.seed,
        winning_restart=fitted.winner,
        fit_options=fitted.options.as_plain_data(),
        evaluation=evaluation.as_plain_data(),
        reference_poses=references.tolist(),
        reference_joint_positions=fitted.network.joint_positions(references).tolist(),
    )

"""Write a trained network as a model file, after proving that the file computes the same."""

from pathlib import Path

import numpy as np
import onnx

from annik_core.files import write_file
from annik_core.installation import annik_version
from annik_core.model.artifact import checked_model
from annik_core.model.errors import ModelError
from annik_core.model.graph import FEATURES_NAME, INPUT_NAME, OUTPUT_NAME
from annik_core.model.metadata import FORMAT_VERSION, ModelMetadata
from annik_core.model.session import make_session
from annik_core.pose import FloatArray
from annik_training.designs.registry import random_dataset
from annik_training.evaluation import Evaluation
from annik_training.fitting.fit import FittedNetwork


class ExportMismatch(ModelError):
    """A graph does not compute what it was made from."""

    def __init__(self, path: Path, difference: float, tolerance: float) -> None:
        #: Largest difference between their joint positions [rad or m].
        self.difference = difference
        self.tolerance = tolerance
        super().__init__(
            path,
            f"its joint positions differ from the original's by {difference:.3g}; at most "
            f"{tolerance:g} is allowed",
            "nothing was written; report this with your onnxruntime and torch versions",
        )


#: Largest difference between exported and trained network [rad or m].
EXPORT_TOLERANCE = 1e-9
#: Random poses to compare on.
PROOF_POSES = 257
_REFERENCE_POSES = 8


def export_model(fitted: FittedNetwork, evaluation: Evaluation, path: Path) -> ModelMetadata:
    """Write a model file; an existing one is replaced only by a proven new one.

    The evaluation is the network's, for the metadata, which are returned.

    Raises:
        ExportMismatch: if onnxruntime's joint positions differ from the network's by more than
            :data:`EXPORT_TOLERANCE`. Nothing is written then.
        ModelError: if a node would refuse the file. Nothing is written then either.
        NotWritable: if the file can't be written.
    """
    metadata = _metadata(fitted, evaluation)
    robot = fitted.dataset.robot
    proof = random_dataset(robot, robot.joint_box, PROOF_POSES, fitted.options.seed)
    poses = np.concatenate([proof.poses, fitted.dataset.poses])
    expected = fitted.network.joint_positions(poses)
    write_model(fitted.network.as_onnx(), metadata, path, poses, expected, EXPORT_TOLERANCE)
    return metadata


def write_model(
    graph: onnx.ModelProto,
    metadata: ModelMetadata,
    path: Path,
    poses: FloatArray,
    expected: FloatArray,
    tolerance: float,
) -> None:
    """Write a graph and its metadata as a model file that a node accepts, or nothing.

    The graph is proved on poses ``(n, 7)``: its joint positions may differ by the tolerance from
    those expected ``(n, dof)`` [rad or m].

    Raises: as :func:`export_model`.
    """
    onnx.helper.set_model_props(graph, metadata.to_properties())
    graph.producer_name = "annik"
    graph.producer_version = annik_version()
    onnx.checker.check_model(graph, full_check=True)
    content = graph.SerializeToString(deterministic=True)
    prove_export(content, poses, expected, tolerance, path)
    checked_model(content, path)
    write_file(path, content)


def prove_export(
    content: bytes, poses: FloatArray, expected: FloatArray, tolerance: float, path: Path
) -> None:
    """Run a graph by onnxruntime: all poses at once, and the first of them one at a time.

    Raises:
        ExportMismatch: if a joint position differs from the expected one by more than the
            tolerance, or is NaN.
    """
    session = make_session(content, path)
    in_batch = session.run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
    alone = np.concatenate(
        [session.run([OUTPUT_NAME], {INPUT_NAME: pose[np.newaxis]})[0] for pose in poses[:16]]
    )
    difference = max(
        float(np.abs(in_batch - expected).max()), float(np.abs(alone - expected[:16]).max())
    )
    if not difference <= tolerance:
        raise ExportMismatch(path, difference, tolerance)


def _metadata(fitted: FittedNetwork, evaluation: Evaluation) -> ModelMetadata:
    dataset = fitted.dataset
    robot = dataset.robot
    references = random_dataset(
        robot, robot.joint_box, _REFERENCE_POSES, fitted.options.seed + 1
    ).poses
    return ModelMetadata(
        format_version=FORMAT_VERSION,
        package_version=annik_version(),
        robot=dict(robot.definition),
        robot_hash=robot.definition_hash,
        joint_names=list(robot.joint_names),
        base_frame=robot.base_frame,
        end_effector_frame=robot.end_effector_frame,
        joint_box_lower=robot.joint_box.lower.tolist(),
        joint_box_upper=robot.joint_box.upper.tolist(),
        encoding=fitted.network.encoding.name,
        features=FEATURES_NAME,
        hidden_units=list(fitted.options.hidden_units),
        design=dataset.design,
        design_options=dict(dataset.design_options),
        examples=len(dataset),
        held_out_examples=len(fitted.held_out),
        dataset_hash=dataset.content_hash,
        seed=fitted.options.seed,
        winning_restart=fitted.winner,
        fit_options=fitted.options.to_dict(),
        evaluation=evaluation.to_dict(),
        reference_poses=references.tolist(),
        reference_joint_positions=fitted.network.joint_positions(references).tolist(),
    )

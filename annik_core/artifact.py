"""Load a model file and prove that it is what it says, before anything is commanded with it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import onnxruntime

from annik_core.artifact_metadata import ArtifactMetadata
from annik_core.errors import (
    ArtifactHasExternalData,
    ArtifactNotFound,
    ArtifactNotReadable,
    ArtifactSignatureMismatch,
    ArtifactTooLarge,
    InvalidArtifactMetadata,
    InvalidRobotDefinition,
    NonFiniteWeights,
    RobotMismatch,
)
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_core.robot_library import robot_from_definition
from annik_core.share_directory import share_directory

#: A 6-20-6 network is 20 kB; whatever is thousands of times larger is not a model of annik.
MAX_FILE_SIZE = 64 * 1024 * 1024

INPUT_NAME = "pose"
OUTPUT_NAME = "joint_positions"

#: How far the loaded network may be from its stored reference answers [rad or m]. Kernels round
#: differently from one processor to the next; an altered weight is off by far more.
REFERENCE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class ModelArtifact:
    """A validated model file, ready to run.

    Attributes:
        path: where it was read from.
        sha256: of the file.
        metadata: what it says of itself.
        robot: the robot that it carries.
        session: the onnxruntime session.
    """

    path: Path
    sha256: str
    metadata: ArtifactMetadata
    robot: Robot
    session: onnxruntime.InferenceSession

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """The network's answer, unchecked: joint positions ``(n, dof)`` for poses ``(n, 7)``."""
        answer: FloatArray = self.session.run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
        return answer


def default_model_path() -> Path:
    """The packaged model of the gantry."""
    return share_directory() / "models" / "gantry.onnx"


def load_artifact(path: str | Path, expected_robot: Robot | None = None) -> ModelArtifact:
    """Read a model file and check all of it.

    Args:
        path: the ``.onnx`` file.
        expected_robot: if given, the robot that the file must be for.

    Raises:
        ArtifactNotFound: if there is no such file.
        ArtifactTooLarge: if it is larger than :data:`MAX_FILE_SIZE`.
        ArtifactNotReadable: if it is truncated, not ONNX, or onnxruntime refuses it.
        ArtifactHasExternalData: if weights are stored elsewhere.
        NonFiniteWeights: if a weight is NaN or infinite.
        MissingArtifactMetadata: if an entry of the metadata is missing.
        UnsupportedArtifactVersion: if the format is another one.
        InvalidArtifactMetadata: if the metadata contradicts itself, the robot or the network.
        ArtifactSignatureMismatch: if inputs or outputs are not those of the contract.
        RobotMismatch: if the file is for another robot than expected.
    """
    file = Path(path)
    content = _read(file)
    model = _parse(content, file)
    _check_weights(model, file)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    metadata = ArtifactMetadata.from_properties(properties, file)
    robot = _robot(metadata, file)
    session = make_session(content, file)
    _check_signature(session, robot, file)
    artifact = ModelArtifact(file, hashlib.sha256(content).hexdigest(), metadata, robot, session)
    _check_references(artifact)
    if expected_robot is not None and robot.definition_hash != expected_robot.definition_hash:
        raise RobotMismatch(
            f"model {file}",
            f"{expected_robot.name} ({expected_robot.definition_hash[:12]})",
            f"{robot.name} ({robot.definition_hash[:12]})",
        )
    return artifact


def make_session(content: bytes, path: Path) -> onnxruntime.InferenceSession:
    """An onnxruntime session that neither spins nor starts threads.

    Raises:
        ArtifactNotReadable: if onnxruntime refuses the graph.
    """
    options = onnxruntime.SessionOptions()
    # One small network: threads only add latency, and spinning ones take a whole core.
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(
            content,
            sess_options=options,
            providers=["CPUExecutionProvider"],
            # Otherwise a file that fails is tried again, with a banner on standard output.
            enable_fallback=0,
        )
    # onnxruntime's exceptions have no common base but Exception.
    except Exception as error:
        reason = str(error).splitlines()[0]
        raise ArtifactNotReadable(path, f"onnxruntime can't load it ({reason})") from error


def _read(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise ArtifactTooLarge(path, size, MAX_FILE_SIZE)
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ArtifactNotFound(path) from error
    except OSError as error:
        raise ArtifactNotReadable(path, f"can't be read ({error.strerror})") from error


def _parse(content: bytes, path: Path) -> onnx.ModelProto:
    try:
        model = onnx.load_model_from_string(content)
    # The protobuf library's DecodeError has moved between its versions.
    except Exception as error:
        raise ArtifactNotReadable(path, "not an ONNX file, or truncated") from error
    if not model.HasField("graph") or not model.graph.node:
        raise ArtifactNotReadable(path, "not an ONNX file, or truncated: it has no graph")
    return model


def _check_weights(model: onnx.ModelProto, path: Path) -> None:
    tensors = list(model.graph.initializer)
    tensors += [
        attribute.t
        for node in model.graph.node
        for attribute in node.attribute
        if attribute.type == onnx.AttributeProto.TENSOR
    ]
    for tensor in tensors:
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise ArtifactHasExternalData(path, tensor.name)
        try:
            values = onnx.numpy_helper.to_array(tensor)
        except (ValueError, TypeError, RuntimeError) as error:
            raise ArtifactNotReadable(path, f"tensor {tensor.name!r} is damaged") from error
        if np.issubdtype(values.dtype, np.floating) and not np.isfinite(values).all():
            raise NonFiniteWeights(path, tensor.name)


def _robot(metadata: ArtifactMetadata, path: Path) -> Robot:
    try:
        robot = robot_from_definition(metadata.robot, f"in {path}")
    except InvalidRobotDefinition as error:
        raise InvalidArtifactMetadata(path, "robot", error.problem) from error
    for key, in_metadata, in_robot in (
        ("robot_hash", metadata.robot_hash, robot.definition_hash),
        ("joint_names", tuple(metadata.joint_names), robot.joint_names),
        ("base_frame", metadata.base_frame, robot.base_frame),
        ("end_effector_frame", metadata.end_effector_frame, robot.end_effector_frame),
        ("joint_box_lower", metadata.joint_box_lower, robot.joint_box.lower.tolist()),
        ("joint_box_upper", metadata.joint_box_upper, robot.joint_box.upper.tolist()),
    ):
        if in_metadata != in_robot:
            raise InvalidArtifactMetadata(
                path, key, f"{in_metadata} is not what the robot definition gives, {in_robot}"
            )
    return robot


def _check_signature(session: onnxruntime.InferenceSession, robot: Robot, path: Path) -> None:
    expected = ([(INPUT_NAME, "tensor(double)", 7)], [(OUTPUT_NAME, "tensor(double)", robot.dof)])
    for what, found, wanted in zip(
        ("input", "output"), (session.get_inputs(), session.get_outputs()), expected, strict=True
    ):
        signature = [(node.name, node.type, (node.shape or [None])[-1]) for node in found]
        ranks = [len(node.shape or []) for node in found]
        if signature != wanted or ranks != [2]:
            raise ArtifactSignatureMismatch(
                path, f"{what} is {signature} of rank {ranks}, not {wanted} of rank [2]"
            )


def _check_references(artifact: ModelArtifact) -> None:
    poses = np.array(artifact.metadata.reference_poses, dtype=np.float64)
    expected = np.array(artifact.metadata.reference_joint_positions, dtype=np.float64)
    try:
        answer = artifact.joint_positions(poses)
    except Exception as error:
        reason = str(error).splitlines()[0]
        raise ArtifactNotReadable(artifact.path, f"the network fails ({reason})") from error
    difference = float(np.abs(answer - expected).max()) if answer.shape == expected.shape else None
    if difference is None or not difference <= REFERENCE_TOLERANCE:
        raise InvalidArtifactMetadata(
            artifact.path,
            "reference_joint_positions",
            f"the network answers the reference poses differently (by {difference}): "
            "its weights were altered",
        )

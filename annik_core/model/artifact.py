"""Load a model file and prove that it is what it says, before anything is commanded with it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime

from annik_core.errors import MissingDependency, RobotMismatch
from annik_core.installation import share_directory
from annik_core.model.errors import (
    ArtifactError,
    ArtifactHasExternalData,
    ArtifactNotFound,
    ArtifactNotReadable,
    ArtifactSignatureMismatch,
    ArtifactTooLarge,
    InvalidMetadata,
    NetworkFailed,
    NonFiniteWeights,
)
from annik_core.model.metadata import ModelMetadata
from annik_core.model.session import ENCODING, BoundSession, pose_features, session_from_features
from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot

#: A 6-20-6 network is 20 kB; whatever is thousands of times larger is not a model of annik.
MAX_FILE_SIZE = 64 * 1024 * 1024

INPUT_NAME = "pose"
OUTPUT_NAME = "joint_positions"

#: How far the loaded network may be from its stored reference answers [rad or m]. Kernels round
#: differently from one processor to the next, by far less. This finds alterations that change an
#: answer. One that moves every reference answer by less is not found: for example 1e-4 on a
#: weight of a hidden unit that the output layer barely listens to.
REFERENCE_TOLERANCE = 1e-9

#: The operators of ONNX's own domain that a graph may use. All others are refused: this is what
#: keeps a graph to what the checks see, without subgraphs that have weights of their own, without
#: randomness, without memory from call to call. A new pose encoding may need a few more; add them
#: here if all that holds of them.
# fmt: off
OPERATORS = frozenset({
    # Those of the packaged graph.
    "Abs", "Add", "Atan", "Cast", "Concat", "Cos", "Div", "Gemm", "Less", "MatMul", "Max", "Mul",
    "Round", "Sin", "Slice", "Sqrt", "Sub", "Tanh", "Where",
    # The same, as another version of torch's exporter may write it.
    "Constant", "Gather", "Identity", "Reshape", "Squeeze", "Transpose", "Unsqueeze",
    # Plain arithmetic, for other encodings and activations.
    "Acos", "And", "Asin", "Ceil", "Clip", "Equal", "Exp", "Floor", "Greater", "GreaterOrEqual",
    "LessOrEqual", "Log", "Min", "Neg", "Not", "Or", "Pow", "Reciprocal", "ReduceSum", "Relu",
    "Sigmoid", "Sign", "Tan",
})
# fmt: on

_DOMAINS = ("", "ai.onnx")
_TENSOR_TYPES = (
    onnx.TensorProto.DOUBLE,
    onnx.TensorProto.FLOAT,
    onnx.TensorProto.INT64,
    onnx.TensorProto.INT32,
    onnx.TensorProto.BOOL,
)
_DOUBLE = np.dtype(np.float64)


@dataclass(frozen=True, eq=False)
class Model:
    """A validated model file, ready to run.

    Attributes:
        path: where it was read from.
        sha256: of the file.
        metadata: what it says of itself.
        robot: the robot that it carries.
        session: the onnxruntime session.
        from_features: the same from x, y, z, roll, pitch, yaw on, for one pose; None if the graph
            has no such part.
    """

    path: Path
    sha256: str
    metadata: ModelMetadata
    robot: Robot
    session: onnxruntime.InferenceSession
    from_features: BoundSession | None = None

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """The network's answer: joint positions ``(n, dof)``, unchecked, for poses ``(n, 7)``.

        Raises:
            NetworkFailed: if there is none, or it is not an array of that shape and type.
        """
        try:
            answer: FloatArray = self.session.run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
        # onnxruntime's exceptions have no common base but Exception.
        except Exception as error:
            raise NetworkFailed(self.path, _first_line(error)) from error
        if answer.dtype != _DOUBLE or answer.shape != (len(poses), self.robot.dof):
            raise NetworkFailed(
                self.path,
                f"its answer to {len(poses)} poses is {answer.dtype} of shape {answer.shape}",
            )
        return answer

    def joint_positions_at(
        self, pose: FloatArray, angles: tuple[float, float, float] | None = None
    ) -> FloatArray:
        """The same for one pose ``(7,)``: ``(dof,)``, and quicker.

        Not for several threads at once: pose and answer pass through memory of this object.

        Args:
            pose: a checked pose.
            angles: its :func:`annik_core.pose.roll_pitch_yaw` [rad], if they are at hand.

        Raises:
            NetworkFailed: if there is no answer.
        """
        try:
            if self.from_features is not None:
                features = pose_features(pose, angles)
                if features is not None:
                    return self.from_features(features)
            return self._from_pose(pose)
        except Exception as error:
            raise NetworkFailed(self.path, _first_line(error)) from error

    @cached_property
    def _from_pose(self) -> BoundSession:
        return BoundSession(self.session, (INPUT_NAME, OUTPUT_NAME), (7, self.robot.dof))


def default_model_path() -> Path:
    """The packaged model of the gantry."""
    return share_directory() / "models" / "gantry.onnx"


def packaged_models() -> tuple[str, ...]:
    """Names of the models that come with annik."""
    return tuple(sorted(path.stem for path in (share_directory() / "models").glob("*.onnx")))


def model_path(name_or_path: str | Path) -> Path:
    """The file of a packaged model, by its name, or the path itself if it is not such a name."""
    if str(name_or_path) in packaged_models():
        return share_directory() / "models" / f"{name_or_path}.onnx"
    return Path(name_or_path)


def load_model(path: str | Path, expected_robot: Robot | None = None) -> Model:
    """Read a model file and check all of it.

    Args:
        path: the ``.onnx`` file, or the name of a packaged model.
        expected_robot: if given, the robot that the file must be for, as described or as learned
            from measured poses.

    Raises:
        ArtifactNotFound: if there is no such file.
        ArtifactTooLarge: if it is larger than :data:`MAX_FILE_SIZE`.
        ArtifactNotReadable: if it is truncated, not ONNX, or onnxruntime refuses it.
            Likewise if its graph has an operator that is not one of :data:`OPERATORS`, functions,
            subgraphs, or numbers of other types than a network needs.
        ArtifactHasExternalData: if weights are stored elsewhere.
        NonFiniteWeights: if a weight or constant is NaN or infinite.
        MissingMetadata: if an entry of the metadata is missing.
        UnsupportedArtifactVersion: if the format is another one.
        InvalidMetadata: if the metadata contradicts itself, the robot or the network.
        ArtifactSignatureMismatch: if inputs or outputs are not those of the contract.
        NetworkFailed: if the network has no answer to the reference poses.
        RobotMismatch: if the file is for another robot than expected.
        MissingDependency: if the robot is an arm and Pinocchio is not installed.
    """
    file = model_path(path)
    content = _read(file)
    try:
        artifact = checked_model(content, file)
    except (ArtifactError, MissingDependency):
        raise
    # The bytes may be anything, and the libraries that read them promise no exceptions. Whatever
    # the checks did not foresee is still a file that can't be used, and ends no running node.
    except Exception as error:
        problem = f"damaged ({type(error).__name__}: {_first_line(error)})"
        raise ArtifactNotReadable(file, problem) from error
    robot = artifact.robot
    if expected_robot is not None and robot.nominal_hash != expected_robot.nominal_hash:
        raise RobotMismatch(
            f"model {file}",
            f"{expected_robot.name} ({expected_robot.nominal_hash[:12]})",
            f"{robot.name} ({robot.nominal_hash[:12]})",
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
        reason = f"onnxruntime can't load it ({_first_line(error)})"
        raise ArtifactNotReadable(path, reason) from error


def checked_model(content: bytes, path: Path) -> Model:
    """All checks of :func:`load_model` on the bytes of a file, which need not be there yet.

    Raises:
        ArtifactError: see there.
    """
    model = _parse(content, path)
    _check_graph(model, path)
    metadata = ModelMetadata.from_properties(_properties(model, path), path)
    robot = _robot(metadata, path)
    session = make_session(content, path)
    _check_signature(session, robot, path)
    sha256 = hashlib.sha256(content).hexdigest()
    artifact = Model(path, sha256, metadata, robot, session)
    _check_references(artifact)
    if metadata.encoding != ENCODING:
        return artifact
    return replace(
        artifact,
        from_features=session_from_features(
            model,
            np.array(metadata.reference_poses, dtype=np.float64),
            np.array(metadata.reference_joint_positions, dtype=np.float64),
            REFERENCE_TOLERANCE,
            lambda rest: make_session(rest, path),
        ),
    )


def _read(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_SIZE:
            raise ArtifactTooLarge(path, size, MAX_FILE_SIZE)
        return path.read_bytes()
    # ValueError: a path that no system could have, such as one with a NUL in it.
    except (FileNotFoundError, ValueError) as error:
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


def _check_graph(model: onnx.ModelProto, path: Path) -> None:
    """Refuse whatever could hide from the checks, and numbers that are not finite."""
    if model.functions:
        raise ArtifactNotReadable(path, "it defines functions of its own")
    if model.graph.sparse_initializer:
        raise ArtifactNotReadable(path, "it has sparse tensors")
    for tensor in model.graph.initializer:
        _check_tensor(tensor, path)
    for node in model.graph.node:
        if node.domain not in _DOMAINS or node.op_type not in OPERATORS:
            operator = f"{node.domain}.{node.op_type}" if node.domain else node.op_type
            raise ArtifactNotReadable(path, f"operator {operator!r} is not one that a model uses")
        for attribute in node.attribute:
            _check_attribute(attribute, node, path)


def _check_attribute(attribute: onnx.AttributeProto, node: onnx.NodeProto, path: Path) -> None:
    # By the fields, not by the type that the attribute claims to be of.
    if (
        any(attribute.HasField(field) for field in ("g", "sparse_tensor", "tp"))
        or any((attribute.graphs, attribute.tensors, attribute.sparse_tensors))
        or attribute.type_protos
    ):
        raise ArtifactNotReadable(
            path, f"attribute {attribute.name!r} of {node.op_type} is not numbers or text"
        )
    if attribute.HasField("t"):
        _check_tensor(attribute.t, path)
    if not np.isfinite([attribute.f, *attribute.floats]).all():
        raise NonFiniteWeights(path, f"{attribute.name} of {node.op_type}")


def _check_tensor(tensor: onnx.TensorProto, path: Path) -> None:
    if tensor.data_location == onnx.TensorProto.EXTERNAL:
        raise ArtifactHasExternalData(path, tensor.name)
    if tensor.data_type not in _TENSOR_TYPES:
        raise ArtifactNotReadable(
            path, f"tensor {tensor.name!r} is of type {tensor.data_type}, which no model uses"
        )
    try:
        values = onnx.numpy_helper.to_array(tensor)
    except (ValueError, TypeError, RuntimeError) as error:
        raise ArtifactNotReadable(path, f"tensor {tensor.name!r} is damaged") from error
    if not np.isfinite(values).all():
        raise NonFiniteWeights(path, tensor.name)


def _properties(model: onnx.ModelProto, path: Path) -> dict[str, str]:
    properties: dict[str, str] = {}
    for entry in model.metadata_props:
        if entry.key in properties:
            # Which of them counts would depend on who reads the file.
            raise InvalidMetadata(path, entry.key, "there more than once")
        properties[entry.key] = entry.value
    return properties


def _robot(metadata: ModelMetadata, path: Path) -> Robot:
    try:
        robot = robot_from_definition(metadata.robot, f"in {path}")
    except InvalidRobotDefinition as error:
        raise InvalidMetadata(path, "robot", error.problem) from error
    for key, in_metadata, in_robot in (
        ("robot_hash", metadata.robot_hash, robot.definition_hash),
        ("joint_names", tuple(metadata.joint_names), robot.joint_names),
        ("base_frame", metadata.base_frame, robot.base_frame),
        ("end_effector_frame", metadata.end_effector_frame, robot.end_effector_frame),
        ("joint_box_lower", metadata.joint_box_lower, robot.joint_box.lower.tolist()),
        ("joint_box_upper", metadata.joint_box_upper, robot.joint_box.upper.tolist()),
    ):
        if in_metadata != in_robot:
            raise InvalidMetadata(
                path, key, f"{in_metadata} is not what the robot definition gives, {in_robot}"
            )
    return robot


def _check_signature(session: onnxruntime.InferenceSession, robot: Robot, path: Path) -> None:
    for what, nodes, name, width in (
        ("input", session.get_inputs(), INPUT_NAME, 7),
        ("output", session.get_outputs(), OUTPUT_NAME, robot.dof),
    ):
        found = [(node.name, node.type, _open_dimensions(node.shape)) for node in nodes]
        wanted = [(name, "tensor(double)", ["n", width])]
        if found != wanted:
            raise ArtifactSignatureMismatch(path, f"{what} is {found}, not {wanted}")


def _open_dimensions(shape: list[Any]) -> list[Any]:
    """A shape with ``"n"`` for each dimension that is left open, whatever its name."""
    return [size if isinstance(size, int) else "n" for size in shape]


def _check_references(artifact: Model) -> None:
    poses = np.array(artifact.metadata.reference_poses, dtype=np.float64)
    expected = np.array(artifact.metadata.reference_joint_positions, dtype=np.float64)
    in_batch = artifact.joint_positions(poses)
    # As the solver asks. A graph may be right for one number of poses only.
    alone = np.concatenate([artifact.joint_positions(pose[np.newaxis]) for pose in poses])
    difference = float(np.abs([in_batch - expected, alone - expected]).max())
    if difference <= REFERENCE_TOLERANCE:
        bound = np.array([artifact.joint_positions_at(pose) for pose in poses])
        difference = float(np.abs(bound - expected).max())
    if not difference <= REFERENCE_TOLERANCE:
        raise InvalidMetadata(
            artifact.path,
            "reference_joint_positions",
            f"the network answers the reference poses differently (by {difference}): "
            "its weights were altered",
        )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]

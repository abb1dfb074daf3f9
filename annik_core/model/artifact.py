"""Load a model file, and prove that it computes what it says before a robot moves by it."""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime

from annik_core.errors import RobotMismatch
from annik_core.files import read_regular_file
from annik_core.installation import model_path, nearest_first, packaged_models
from annik_core.kernel import compiled_kernel
from annik_core.model.errors import (
    InvalidGraph,
    InvalidMetadata,
    ModelError,
    ModelNotFound,
    NetworkFailed,
    UnreadableModel,
)
from annik_core.model.graph import (
    INPUT_NAME,
    OUTPUT_NAME,
    LayerOfGraph,
    check_graph,
    graph_of,
    graph_properties,
    layers_of,
    nodes_after,
    parsed_graph,
)
from annik_core.model.metadata import ModelMetadata, Quality, quality_of
from annik_core.model.session import (
    PLAIN_ENCODINGS,
    BoundSession,
    PlainEncoding,
    first_line,
    make_session,
)
from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot

#: A million weights; a 6-20-6 network is 20 kB. Empty operators take sixty times the memory of the
#: file while it is read.
MAX_FILE_SIZE = 8 * 1024 * 1024

#: Largest difference from the reference answers [rad or m]. Rounding differs by far less from one
#: processor to the next. An alteration that moves no reference answer by more is not found, such
#: as 1e-4 on a weight of a hidden unit that has hardly any effect.
REFERENCE_TOLERANCE = 1e-9

_DOUBLE = np.dtype(np.float64)


@dataclass(frozen=True, eq=False)
class Model:
    """A checked model file, ready to run.

    ``encoding`` and ``after_features`` are for one pose: its encoding in plain floats, and the
    part of the graph after it; None where plain floats do not compute that encoding.
    ``start_network`` is that part in the compiled kernel, where it is one of layers with tanh.
    It is for starts of a refinement: where the network's output is the answer, onnxruntime
    computes it.
    """

    path: Path
    sha256: str
    metadata: ModelMetadata
    robot: Robot
    session: onnxruntime.InferenceSession
    encoding: PlainEncoding | None = None
    after_features: BoundSession | None = None
    start_network: Any = None

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """The network's joint positions ``(n, dof)`` [rad or m], unchecked, for ``(n, 7)``.

        Raises:
            NetworkFailed: if there are none, or not an array of that shape and type.
        """
        try:
            output: FloatArray = self.session.run([OUTPUT_NAME], {INPUT_NAME: poses})[0]
        # onnxruntime's exceptions have no common base but Exception.
        except Exception as error:
            raise self._failed(first_line(error)) from error
        if output.dtype != _DOUBLE or output.shape != (len(poses), self.robot.dof):
            raise self._failed(f"for {len(poses)} poses: {output.dtype} of shape {output.shape}")
        return output

    def joint_positions_at(self, pose: FloatArray) -> FloatArray:
        """:meth:`joint_positions` ``(dof,)`` for one checked pose ``(7,)``, and faster.

        Not for several threads at once: the numbers pass through memory of this object.

        Raises:
            NetworkFailed: if there are none.
        """
        try:
            if self.encoding is not None and self.after_features is not None:
                features = self.encoding.features(pose)
                if features is not None:
                    return self.after_features(features)
            return self._whole_graph(pose.tobytes())
        except Exception as error:
            raise self._failed(first_line(error)) from error

    def start_at(self, pose: FloatArray) -> FloatArray:
        """Where a search for one checked pose ``(7,)`` begins: joint positions ``(dof,)``.

        As :meth:`joint_positions_at`, but from the kernel's network where there is one.
        """
        if self.start_network is not None and self.encoding is not None:
            features = self.encoding.features(pose)
            if features is not None:
                start: FloatArray = self.start_network.run(np.frombuffer(features))
                return start
        return self.joint_positions_at(pose)

    def after_encoding(self, name: str) -> BoundSession | None:
        """:attr:`after_features` if the encoding is the one of that name, otherwise None."""
        return self.after_features if self.metadata.encoding == name else None

    def run(self, bound: BoundSession) -> None:
        """Run one of its bound sessions on what is in the input.

        Raises:
            NetworkFailed: if it fails.
        """
        try:
            bound.run()
        except Exception as error:
            raise self._failed(first_line(error)) from error

    @cached_property
    def quality(self) -> Quality:
        """What the model solves, by the evaluation of its training."""
        return quality_of(self.metadata.evaluation)

    @cached_property
    def _whole_graph(self) -> BoundSession:
        return BoundSession(self.session, (INPUT_NAME, OUTPUT_NAME), (7, self.robot.dof))

    def _failed(self, reason: str) -> NetworkFailed:
        return NetworkFailed(self.path, f"the network fails ({reason})")


def load_model(path: str | Path, expected_robot: Robot | None = None) -> Model:
    """Read a model file, or a packaged model by its name, and check all of it.

    Raises:
        ModelError: if the file can't be used; the classes are in :mod:`annik_core.model.errors`.
        RobotMismatch: if the file is for another robot than expected, as described or calibrated.
    """
    file = model_path(path)
    content = read_model_file(file)
    try:
        model = checked_model(content, file)
    except ModelError:
        raise
    # The bytes may be anything, and the libraries that read them promise no exceptions. What the
    # checks did not foresee must end no running node either.
    except Exception as error:
        problem = f"damaged ({type(error).__name__}: {first_line(error)})"
        raise UnreadableModel(file, problem) from error
    robot = model.robot
    if expected_robot is not None and robot.nominal_hash != expected_robot.nominal_hash:
        raise RobotMismatch(
            f"model {file}",
            f"{expected_robot.name} ({expected_robot.nominal_hash[:12]})",
            f"{robot.name} ({robot.nominal_hash[:12]})",
        )
    return model


def read_model_file(path: Path) -> bytes:
    """The bytes of a model file.

    Raises:
        ModelNotFound: if there is no such file.
        UnreadableModel: if it can't be read, is no regular file, or is too large.
    """
    try:
        return read_regular_file(path, MAX_FILE_SIZE)
    # ValueError: a path that no system could have, such as one with a NUL in it.
    except (FileNotFoundError, ValueError) as error:
        raise ModelNotFound(path, nearest_first(path.stem, packaged_models())) from error
    except OSError as error:
        raise UnreadableModel(path, f"can't be read ({error.strerror})") from error


def checked_model(content: bytes, path: Path) -> Model:
    """All checks of :func:`load_model` on the bytes of a file, which need not exist yet."""
    graph = parsed_graph(content, path)
    check_graph(graph, path)
    metadata = ModelMetadata.from_properties(graph_properties(graph, path), path)
    robot = _robot(metadata, path)
    # Not the content: onnxruntime gets only what was looked at.
    session = make_session(graph.SerializeToString(), path)
    _check_signature(session, robot, path)
    nodes = nodes_after(metadata.features, graph, path)
    model = Model(path, hashlib.sha256(content).hexdigest(), metadata, robot, session)
    _check_references(model)
    encoding = PLAIN_ENCODINGS.get(metadata.encoding)
    if encoding is None or None in map(encoding.features, _references(model)):
        return model
    model = _with_plain_encoding(model, encoding, graph_of(nodes, metadata.features, graph))
    if compiled_kernel() is None:
        return model
    return _with_start_network(model, encoding, layers_of(nodes, metadata.features, graph, path))


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
            problem = f"{in_metadata} is not what the robot definition gives, {in_robot}"
            raise InvalidMetadata(path, key, problem)
    return robot


def _check_signature(session: onnxruntime.InferenceSession, robot: Robot, path: Path) -> None:
    for part, nodes, name, width in (
        ("input", session.get_inputs(), INPUT_NAME, 7),
        ("output", session.get_outputs(), OUTPUT_NAME, robot.dof),
    ):
        found = [(node.name, node.type, _open_dimensions(node.shape)) for node in nodes]
        wanted = [(name, "tensor(double)", ["n", width])]
        if found != wanted:
            raise InvalidGraph(path, part, f"is {found}, not {wanted}")


def _open_dimensions(shape: list[Any]) -> list[Any]:
    """A shape with ``"n"`` for each dimension that is left open, whatever its name."""
    return [size if isinstance(size, int) else "n" for size in shape]


def _check_references(model: Model) -> None:
    """Compare with the reference answers: in a batch, one at a time, and bound to memory."""
    poses = _references(model)
    in_batch = model.joint_positions(poses)
    alone = np.concatenate([model.joint_positions(pose[np.newaxis]) for pose in poses])
    _compare(model, "reference_joint_positions", in_batch, alone)
    _compare(model, "reference_joint_positions", _one_at_a_time(model))


def _with_plain_encoding(model: Model, encoding: PlainEncoding, after_features: Any) -> Model:
    """The model with the part after its features bound, and compared with the references."""
    path, features = model.path, model.metadata.features
    session = make_session(after_features.SerializeToString(), path)
    bound = BoundSession(session, (features, OUTPUT_NAME), (encoding.width, model.robot.dof))
    faster = replace(model, encoding=encoding, after_features=bound)
    try:
        _compare(faster, "features", _one_at_a_time(faster))
    # Of another width, for example.
    except NetworkFailed as error:
        raise InvalidMetadata(path, "features", error.problem) from error
    return faster


def _with_start_network(
    model: Model, encoding: PlainEncoding, layers: list[LayerOfGraph] | None
) -> Model:
    """The model with its network in the kernel, if it can be, compared with the references."""
    if layers is None:
        return model
    network = compiled_kernel().Network(encoding.width, layers)
    features = map(encoding.features, _references(model))
    found = [network.run(np.frombuffer(row)) for row in features if row is not None]
    _compare(model, "reference_joint_positions", np.array(found))
    return replace(model, start_network=network)


def _references(model: Model) -> FloatArray:
    return np.array(model.metadata.reference_poses, dtype=np.float64)


def _one_at_a_time(model: Model) -> FloatArray:
    return np.array([model.joint_positions_at(pose) for pose in _references(model)])


def _compare(model: Model, key: str, *found: FloatArray) -> None:
    expected = np.array(model.metadata.reference_joint_positions, dtype=np.float64)
    difference = float(np.abs(np.array(found) - expected).max())
    if not difference <= REFERENCE_TOLERANCE:
        problem = (
            f"the network's joint positions differ from the reference answers by {difference}: "
            "the weights were altered"
        )
        raise InvalidMetadata(model.path, key, problem)

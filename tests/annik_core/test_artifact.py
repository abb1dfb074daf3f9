"""A model file that is not whole and unaltered is refused, each by its own error. ROS-free."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from annik_core import errors
from annik_core.artifact import MAX_FILE_SIZE, default_model_path, load_artifact
from annik_core.robot import Robot
from annik_core.robot_library import robot_from_definition

PACKAGED = default_model_path().read_bytes()


def altered(path: Path, change: Callable[[onnx.ModelProto], None]) -> Path:
    """The packaged model after a change."""
    model = onnx.load_model_from_string(PACKAGED)
    change(model)
    path.write_bytes(model.SerializeToString())
    return path


def entry(model: onnx.ModelProto, key: str) -> onnx.StringStringEntryProto:
    return next(prop for prop in model.metadata_props if prop.key == f"annik.{key}")


def with_entry(path: Path, key: str, value: object) -> Path:
    def change(model: onnx.ModelProto) -> None:
        entry(model, key).value = json.dumps(value)

    return altered(path, change)


def weight(model: onnx.ModelProto) -> TensorProto:
    return next(t for t in model.graph.initializer if len(t.dims) == 2 and 20 in t.dims)


def test_the_packaged_model_loads(gantry: Robot) -> None:
    artifact = load_artifact(default_model_path(), gantry)
    assert artifact.robot.joint_names == gantry.joint_names
    assert artifact.metadata.examples == 179
    assert len(artifact.sha256) == 64


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(errors.ArtifactNotFound, match=r"none\.onnx"):
        load_artifact(tmp_path / "none.onnx")


def test_a_folder(tmp_path: Path) -> None:
    with pytest.raises(errors.ArtifactNotReadable, match="can't be read"):
        load_artifact(tmp_path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 a zip", b"pose: 1\n", os.urandom(5000)])
def test_not_onnx(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(content)
    with pytest.raises(errors.ArtifactNotReadable, match="not an ONNX file"):
        load_artifact(path)


@given(st.integers(0, len(PACKAGED) - 1))
def test_truncated_anywhere(tmp_path_factory: pytest.TempPathFactory, length: int) -> None:
    """Whatever is left, it is a typed error that names the file."""
    path = tmp_path_factory.mktemp("cut") / "model.onnx"
    path.write_bytes(PACKAGED[:length])
    with pytest.raises(errors.ArtifactError, match=r"model\.onnx"):
        load_artifact(path)


@given(st.integers(0, len(PACKAGED) - 1), st.integers(1, 255))
def test_a_changed_byte_never_crashes(
    tmp_path_factory: pytest.TempPathFactory, position: int, flip: int
) -> None:
    """It loads, where the byte has no meaning, or is a typed error; nothing else."""
    content = bytearray(PACKAGED)
    content[position] ^= flip
    path = tmp_path_factory.mktemp("changed") / "model.onnx"
    path.write_bytes(bytes(content))
    try:
        load_artifact(path)
    except errors.ArtifactError as error:
        assert "model.onnx" in str(error)


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    with path.open("wb") as file:
        file.truncate(MAX_FILE_SIZE + 1)
    with pytest.raises(errors.ArtifactTooLarge, match="at most"):
        load_artifact(path)


def test_weights_outside_the_file(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        tensor = weight(model)
        tensor.data_location = TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="weights.bin")

    with pytest.raises(errors.ArtifactHasExternalData, match="outside the file"):
        load_artifact(altered(tmp_path / "model.onnx", change))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_weight_that_is_not_finite(tmp_path: Path, value: float) -> None:
    def change(model: onnx.ModelProto) -> None:
        tensor = weight(model)
        array = numpy_helper.to_array(tensor).copy()
        array.flat[3] = value
        tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))

    with pytest.raises(errors.NonFiniteWeights, match="not finite"):
        load_artifact(altered(tmp_path / "model.onnx", change))


@pytest.mark.parametrize("name", ["hidden.layers.0.bias", "output.weight", "output.bias"])
def test_an_altered_weight(tmp_path: Path, name: str) -> None:
    """The stored reference answers tell, if the weight has any effect on an answer."""

    def change(model: onnx.ModelProto) -> None:
        tensor = next(t for t in model.graph.initializer if t.name == name)
        array = numpy_helper.to_array(tensor) + 1e-6
        tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))

    with pytest.raises(errors.InvalidArtifactMetadata, match="weights were altered"):
        load_artifact(altered(tmp_path / "model.onnx", change))


KEYS = sorted(
    prop.key.removeprefix("annik.")
    for prop in onnx.load_model_from_string(PACKAGED).metadata_props
)


@pytest.mark.parametrize("key", KEYS)
def test_a_missing_entry_is_named(tmp_path: Path, key: str) -> None:
    def change(model: onnx.ModelProto) -> None:
        model.metadata_props.remove(entry(model, key))

    with pytest.raises(errors.MissingArtifactMetadata, match=f"annik.{key}"):
        load_artifact(altered(tmp_path / "model.onnx", change))


@pytest.mark.parametrize("key", [key for key in KEYS if key != "format_version"])
def test_an_entry_of_another_type_is_named(tmp_path: Path, key: str) -> None:
    """A number as text, a list as number: for every entry."""
    loaded = json.loads(entry(onnx.load_model_from_string(PACKAGED), key).value)
    value = 7 if isinstance(loaded, str) else "seven"
    with pytest.raises(errors.InvalidArtifactMetadata, match=key):
        load_artifact(with_entry(tmp_path / "model.onnx", key, value))


def test_an_entry_that_is_not_json(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        entry(model, "robot").value = "{"

    with pytest.raises(errors.InvalidArtifactMetadata, match="not JSON"):
        load_artifact(altered(tmp_path / "model.onnx", change))


@pytest.mark.parametrize("version", ["0", "2", 1, None])
def test_another_format_version(tmp_path: Path, version: object) -> None:
    path = with_entry(tmp_path / "model.onnx", "format_version", version)
    with pytest.raises(errors.UnsupportedArtifactVersion, match="reads 1"):
        load_artifact(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("joint_names", ["a", "b", "c", "d", "e", "f"]),
        ("base_frame", "world"),
        ("joint_box_lower", [0.0] * 6),
        ("robot_hash", "0" * 64),
        ("reference_poses", [[0.0] * 6]),
        ("reference_joint_positions", [[0.0] * 6]),
    ],
)
def test_metadata_that_contradicts_itself(tmp_path: Path, key: str, value: object) -> None:
    with pytest.raises(errors.InvalidArtifactMetadata, match=key):
        load_artifact(with_entry(tmp_path / "model.onnx", key, value))


def test_a_robot_that_makes_no_sense(tmp_path: Path) -> None:
    path = with_entry(tmp_path / "model.onnx", "robot", {"kind": "octopus"})
    with pytest.raises(errors.InvalidArtifactMetadata, match="octopus"):
        load_artifact(path)


@pytest.mark.parametrize("what", ["name", "type", "width"])
def test_another_signature(tmp_path: Path, what: str) -> None:
    """A graph whose input is not 'pose', double, (n, 7)."""

    def change(model: onnx.ModelProto) -> None:
        name = "target" if what == "name" else "pose"
        kind = TensorProto.FLOAT if what == "type" else TensorProto.DOUBLE
        width = 6 if what == "width" else 7
        columns = numpy_helper.from_array(np.array([0, 1, 2, 3, 4, 5]), "columns")
        nodes = [
            helper.make_node("Gather", [name, "columns"], ["picked"], axis=1),
            helper.make_node("Cast", ["picked"], ["joint_positions"], to=TensorProto.DOUBLE),
        ]
        graph = helper.make_graph(
            nodes,
            "other",
            [helper.make_tensor_value_info(name, kind, ["n", width])],
            [helper.make_tensor_value_info("joint_positions", TensorProto.DOUBLE, ["n", 6])],
            [columns],
        )
        model.graph.CopyFrom(graph)

    with pytest.raises(errors.ArtifactSignatureMismatch, match="input is"):
        load_artifact(altered(tmp_path / "model.onnx", change))


def test_an_operator_that_does_not_exist(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        model.graph.node[-1].op_type = "Telepathy"

    with pytest.raises(errors.ArtifactNotReadable, match="onnxruntime"):
        load_artifact(altered(tmp_path / "model.onnx", change))


def test_the_model_of_another_robot(gantry: Robot) -> None:
    """Both robots are named."""
    other = robot_from_definition({**gantry.definition, "name": "portal"}, "test")
    with pytest.raises(errors.RobotMismatch, match=r"belongs to robot gantry .*, not to portal"):
        load_artifact(default_model_path(), other)

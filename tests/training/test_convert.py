"""Files of format 1 become files of today that compute the same. ROS-free.

``format_1/`` holds small models that annik wrote in format 1, of both encodings.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from click.testing import CliRunner
from onnx import numpy_helper

from annik_core.errors import NotWritable
from annik_core.installation import default_model_path
from annik_core.model.artifact import load_model
from annik_core.model.errors import InvalidMetadata, ModelNotFound, UnsupportedFormat
from annik_core.model.session import make_session
from annik_training.cli import cli
from annik_training.convert import NotConvertible, convert_model
from annik_training.designs.sampling import random_dataset

FOLDER = Path(__file__).parent / "format_1"
EACH = pytest.mark.parametrize("name", ["gantry", "gantry_linear_path", "scara"])


def properties(path: Path) -> dict[str, object]:
    return {p.key: json.loads(p.value) for p in onnx.load(path).metadata_props}


def altered(source: Path, path: Path, tensor: str, change: float) -> Path:
    model = onnx.load(source)
    weight = next(t for t in model.graph.initializer if t.name == tensor)
    weight.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(weight) + change, tensor))
    onnx.save(model, path)
    return path


@EACH
def test_a_converted_file_computes_the_same_and_says_the_same(name: str, tmp_path: Path) -> None:
    """But for the format and the name of the features."""
    old, new = FOLDER / f"{name}.onnx", tmp_path / "deep" / "new.onnx"
    with pytest.raises(UnsupportedFormat) as caught:
        load_model(old)
    assert caught.value.convertible
    content = old.read_bytes()
    metadata = convert_model(old, new)
    assert old.read_bytes() == content
    model = load_model(new)
    assert model.metadata == metadata
    changed = {"annik.format_version": "2", "annik.features": "features"}
    assert properties(new) == properties(old) | changed
    robot = model.robot
    poses = random_dataset(robot, robot.joint_box, 200, seed=99).poses
    expected = make_session(content, old).run(None, {"pose": poses})[0]
    assert model.joint_positions(poses) == pytest.approx(expected, abs=1e-12, rel=0)
    alone = np.array([model.joint_positions_at(pose) for pose in poses])
    assert alone == pytest.approx(expected, abs=1e-10, rel=0)


def test_a_file_may_be_converted_in_its_place(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes((FOLDER / "scara.onnx").read_bytes())
    convert_model(path, path)
    assert load_model(path).robot.name == "scara"
    with pytest.raises(NotConvertible) as caught:
        convert_model(path, path)
    assert caught.value.path == path


def test_a_file_of_today_is_not_converted(tmp_path: Path) -> None:
    with pytest.raises(NotConvertible):
        convert_model(default_model_path(), tmp_path / "new.onnx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["network.output.bias", "network.hidden.layers.0.weight"])
def test_altered_weights_are_not_converted(tmp_path: Path, name: str) -> None:
    """The reference answers are the old file's, and prove the new one."""
    old = altered(FOLDER / "gantry.onnx", tmp_path / "old.onnx", name, 1e-6)
    with pytest.raises(InvalidMetadata) as caught:
        convert_model(old, tmp_path / "new.onnx")
    assert caught.value.key == "reference_joint_positions"
    assert [path.name for path in tmp_path.iterdir()] == ["old.onnx"]


@pytest.mark.parametrize(
    ("name", "tensor"), [("gantry", "network.output.bias"), ("scara", "others.0.weight")]
)
def test_weights_of_other_names_are_not_converted(tmp_path: Path, name: str, tensor: str) -> None:
    model = onnx.load(FOLDER / f"{name}.onnx")
    next(t for t in model.graph.initializer if t.name == tensor).name = "mine"
    for node in model.graph.node:
        for index, used in enumerate(node.input):
            node.input[index] = "mine" if used == tensor else used
    old = tmp_path / "old.onnx"
    onnx.save(model, old)
    with pytest.raises(NotConvertible) as caught:
        convert_model(old, tmp_path / "new.onnx")
    assert caught.value.path == old


def test_a_file_that_is_not_there_or_a_place_that_can_not_be_written(tmp_path: Path) -> None:
    with pytest.raises(ModelNotFound):
        convert_model(tmp_path / "none.onnx", tmp_path / "new.onnx")
    (tmp_path / "file").write_text("exists", encoding="utf-8")
    with pytest.raises(NotWritable):
        convert_model(FOLDER / "scara.onnx", tmp_path / "file" / "new.onnx")


def test_the_command_that_the_refusal_names(tmp_path: Path) -> None:
    new = tmp_path / "new.onnx"
    result = CliRunner().invoke(
        cli, ["convert", str(FOLDER / "scara.onnx"), "--out", str(new)], catch_exceptions=False
    )
    assert result.exit_code == 0
    assert str(new) in "".join(result.output.split())
    assert load_model(new).robot.name == "scara"

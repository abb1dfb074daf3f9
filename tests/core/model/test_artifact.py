"""A model file that is truncated, altered or hostile is refused by a typed error. ROS-free."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from annik_core.errors import RobotMismatch
from annik_core.installation import default_model_path
from annik_core.model import artifact as artifact_module
from annik_core.model import errors
from annik_core.model.artifact import MAX_FILE_SIZE, load_model
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.safety import IkStatus
from annik_core.serving.ik_server import IkServer
from annik_core.solver.ik_solver import IkSolver

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


WEIGHT = "hidden.0.weight"


def weight(model: onnx.ModelProto) -> TensorProto:
    return next(t for t in model.graph.initializer if t.name == WEIGHT)


def test_the_packaged_model_loads(gantry: Robot) -> None:
    artifact = load_model(default_model_path(), gantry)
    assert artifact.robot.joint_names == gantry.joint_names
    assert artifact.metadata.examples == 179
    assert len(artifact.sha256) == 64


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(errors.ModelNotFound) as caught:
        load_model(tmp_path / "none.onnx")
    assert caught.value.path == tmp_path / "none.onnx"
    assert str(caught.value.path) in str(caught.value)


def test_a_folder(tmp_path: Path) -> None:
    with pytest.raises(errors.UnreadableModel) as caught:
        load_model(tmp_path)
    assert caught.value.path == tmp_path


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 a zip", b"pose: 1\n", os.urandom(5000)])
def test_not_onnx(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(content)
    with pytest.raises(errors.UnreadableModel) as caught:
        load_model(path)
    assert caught.value.path == path


@given(st.integers(0, len(PACKAGED) - 1))
def test_truncated_anywhere(tmp_path_factory: pytest.TempPathFactory, length: int) -> None:
    """Whatever is left, it is a typed error that names the file."""
    path = tmp_path_factory.mktemp("cut") / "model.onnx"
    path.write_bytes(PACKAGED[:length])
    with pytest.raises(errors.ModelError) as caught:
        load_model(path)
    assert caught.value.path == path


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
        load_model(path)
    except errors.ModelError as error:
        assert error.path == path


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    with path.open("wb") as file:
        file.truncate(MAX_FILE_SIZE + 1)
    with pytest.raises(errors.UnreadableModel) as caught:
        load_model(path)
    assert str(MAX_FILE_SIZE) in caught.value.problem
    assert str(MAX_FILE_SIZE + 1) in caught.value.problem


def test_weights_outside_the_file(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        tensor = weight(model)
        tensor.data_location = TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="weights.bin")

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == WEIGHT


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_weight_that_is_not_finite(tmp_path: Path, value: float) -> None:
    def change(model: onnx.ModelProto) -> None:
        tensor = weight(model)
        array = numpy_helper.to_array(tensor).copy()
        array.flat[3] = value
        tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == WEIGHT


@pytest.mark.parametrize("name", ["hidden.0.bias", "output.weight", "output.bias"])
def test_an_altered_weight(tmp_path: Path, name: str) -> None:
    """Found by the reference answers, if the weight has any effect on them."""

    def change(model: onnx.ModelProto) -> None:
        tensor = next(t for t in model.graph.initializer if t.name == name)
        array = numpy_helper.to_array(tensor) + 1e-6
        tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == "reference_joint_positions"


KEYS = sorted(
    prop.key.removeprefix("annik.")
    for prop in onnx.load_model_from_string(PACKAGED).metadata_props
)


@pytest.mark.parametrize("key", KEYS)
def test_a_missing_entry_is_named(tmp_path: Path, key: str) -> None:
    def change(model: onnx.ModelProto) -> None:
        model.metadata_props.remove(entry(model, key))

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == key


@pytest.mark.parametrize("key", [key for key in KEYS if key != "format_version"])
def test_an_entry_of_another_type_is_named(tmp_path: Path, key: str) -> None:
    """A number as text, a list as number: for every entry."""
    loaded = json.loads(entry(onnx.load_model_from_string(PACKAGED), key).value)
    value = 7 if isinstance(loaded, str) else "seven"
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(with_entry(tmp_path / "model.onnx", key, value))
    assert caught.value.key == key


def test_an_entry_that_is_not_json(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        entry(model, "robot").value = "{"

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == "robot"
    assert "not JSON" in caught.value.problem


@pytest.mark.parametrize("version", ["0", "1", "3", 2, None])
def test_another_format_version(tmp_path: Path, version: object) -> None:
    """It is refused with the commands that make a new one."""
    path = with_entry(tmp_path / "model.onnx", "format_version", version)
    with pytest.raises(errors.UnsupportedFormat) as caught:
        load_model(path)
    error = caught.value
    assert (error.found, error.supported) == (str(version), ("2",))
    assert "annik train" in str(error) and "annik calibrate" in str(error)


def test_features_are_an_entry_of_their_own(tmp_path: Path) -> None:
    """The tensor in which the encoding ends; the output is computed from it alone."""
    model = load_model(default_model_path())
    assert model.metadata.features == "features"
    graph = onnx.load_model_from_string(PACKAGED)
    assert "features" in {name for node in graph.graph.node for name in node.output}


@pytest.mark.parametrize(
    "name", ["pose", "joint_positions", "nowhere", "", WEIGHT, "tanh", "a part of the encoding"]
)
def test_features_that_are_not_where_the_encoding_ends(tmp_path: Path, name: str) -> None:
    if name == "a part of the encoding":
        graph = onnx.load_model_from_string(PACKAGED).graph
        name = next(node for node in graph.node if "features" in node.output).input[0]
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(with_entry(tmp_path / "model.onnx", "features", name))
    assert caught.value.key == "features"


def test_features_of_another_encoding_than_the_metadata_say(tmp_path: Path) -> None:
    """Right in the graph as a whole, not for angles that are computed elsewhere."""

    def change(model: onnx.ModelProto) -> None:
        node = next(node for node in model.graph.node if "features" in node.output)
        node.output[0] = "radians"
        two = numpy_helper.from_array(np.array([2.0]), "two")
        half = numpy_helper.from_array(np.array([0.5]), "half")
        model.graph.initializer.extend([two, half])
        after = list(model.graph.node).index(node) + 1
        for name, inputs, output in (
            ("Mul", ["features", "half"], "halved"),
            ("Mul", ["radians", "two"], "features"),
        ):
            model.graph.node.insert(after, helper.make_node(name, inputs, [output]))
        for later in list(model.graph.node)[after + 2 :]:
            for index, tensor in enumerate(later.input):
                if tensor == "features":
                    later.input[index] = "halved"

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == "features"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("joint_names", ["a", "b", "c", "d", "e", "f"]),
        ("base_frame", "world"),
        ("end_effector_frame", "flange"),
        ("joint_box_lower", [0.0] * 6),
        ("joint_box_upper", [1.0] * 6),
        ("joint_box_upper", [10**400] * 6),
        ("robot_hash", "0" * 64),
        ("reference_poses", [[0.0] * 6]),
        ("reference_joint_positions", [[0.0] * 6]),
    ],
)
def test_metadata_that_contradicts_itself(tmp_path: Path, key: str, value: object) -> None:
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(with_entry(tmp_path / "model.onnx", key, value))
    assert caught.value.key == key


def test_a_robot_that_makes_no_sense(tmp_path: Path) -> None:
    path = with_entry(tmp_path / "model.onnx", "robot", {"kind": "octopus"})
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(path)
    assert caught.value.key == "robot"
    assert "octopus" in caught.value.problem


@pytest.mark.parametrize("what", ["name", "type", "width"])
def test_another_signature(tmp_path: Path, what: str) -> None:
    """A graph whose input is not 'pose', double, (n, 7)."""

    def change(model: onnx.ModelProto) -> None:
        name = "target" if what == "name" else "pose"
        kind = TensorProto.FLOAT if what == "type" else TensorProto.DOUBLE
        width = 6 if what == "width" else 7
        numbers = [numpy_helper.from_array(np.array([n]), str(n)) for n in (0, 1, 6)]
        nodes = [
            helper.make_node("Slice", [name, "0", "6", "1"], ["picked"]),
            helper.make_node("Cast", ["picked"], ["joint_positions"], to=TensorProto.DOUBLE),
        ]
        graph = helper.make_graph(
            nodes,
            "other",
            [helper.make_tensor_value_info(name, kind, ["n", width])],
            [helper.make_tensor_value_info("joint_positions", TensorProto.DOUBLE, ["n", 6])],
            numbers,
        )
        model.graph.CopyFrom(graph)

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    # What is computed from an input of another name is computed from nothing.
    assert caught.value.part == ("picked" if what == "name" else "input")


@pytest.mark.parametrize(
    ("name", "kind", "shape"),
    [
        ("joints", TensorProto.DOUBLE, ["n", 6]),
        ("joint_positions", TensorProto.FLOAT, ["n", 6]),
        ("joint_positions", TensorProto.DOUBLE, ["n", 5]),
        ("joint_positions", TensorProto.DOUBLE, ["n", 6, 1]),
        ("joint_positions", TensorProto.DOUBLE, [8, 6]),
    ],
)
def test_another_output(tmp_path: Path, name: str, kind: int, shape: list[Any]) -> None:
    """A graph whose output is not 'joint_positions', double, (n, dof)."""

    def change(model: onnx.ModelProto) -> None:
        # Without a node whose type or shape would contradict it first.
        del model.graph.value_info[:]
        del model.graph.node[:]
        numbers = [numpy_helper.from_array(np.array([n]), str(n)) for n in (0, 1, shape[1])]
        model.graph.initializer.extend(numbers)
        model.graph.node.extend(
            [
                helper.make_node("Slice", ["pose", "0", str(shape[1]), "1"], ["picked"]),
                helper.make_node("Cast", ["picked"], [name], to=kind),
            ]
        )
        output = helper.make_tensor_value_info(name, kind, shape)
        model.graph.output[0].CopyFrom(output)

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == "output"


@pytest.mark.parametrize("batch", [1, 8])
def test_an_input_for_one_number_of_poses_only(tmp_path: Path, batch: int) -> None:
    def change(model: onnx.ModelProto) -> None:
        model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = batch

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == "input"


def test_a_graph_that_onnxruntime_refuses(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        model.opset_import[0].version = 999

    with pytest.raises(errors.UnreadableModel) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert "onnxruntime" in caught.value.problem


def with_node(model: onnx.ModelProto, node: onnx.NodeProto) -> None:
    model.graph.node.insert(0, node)


def chained(operator: str, start: str, links: int) -> Callable[[onnx.ModelProto], None]:
    """Operators that each give the next one more numbers, or more work, from a tensor on."""

    def change(model: onnx.ModelProto) -> None:
        model.graph.initializer.append(numpy_helper.from_array(np.ones((1, 7)), "row"))
        model.graph.initializer.append(numpy_helper.from_array(np.ones((7, 1)), "column"))
        model.graph.initializer.append(numpy_helper.from_array(np.ones((600, 600)), "square"))
        for link in reversed(range(links)):
            inputs = [f"link{link}" if link else start] * 2
            inputs = [inputs[0], "square"] if operator == "MatMul" else inputs
            options = {"axis": 1} if operator == "Concat" else {}
            with_node(model, helper.make_node(operator, inputs, [f"link{link + 1}"], **options))

    return change


@pytest.mark.parametrize(
    "change",
    [
        chained("Concat", "pose", 30),
        # Constants are computed while onnxruntime loads the graph.
        chained("Concat", "row", 30),
        chained("MatMul", "square", 30),
        chained("Neg", "pose", 2000),
        lambda model: model.graph.initializer.extend([weight(model)] * 2000),
        lambda model: model.metadata_props.extend([entry(model, "seed")] * 2000),
        lambda model: with_node(model, helper.make_node("Max", ["pose"] * 2000, ["unused"])),
        lambda model: model.graph.node[0].attribute.extend([helper.make_attribute("a", 1)] * 2000),
    ],
    ids=[
        "concat",
        "concat of constants",
        "products",
        "nodes",
        "tensors",
        "entries",
        "inputs",
        "attributes",
    ],
)
def test_a_graph_that_multiplies_what_it_gets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[onnx.ModelProto], None]
) -> None:
    """Refused before onnxruntime sees it, in bounded memory and time."""
    monkeypatch.setattr(artifact_module, "make_session", None)
    path = altered(tmp_path / "model.onnx", change)
    start = time.process_time()
    tracemalloc.start()
    with pytest.raises(errors.InvalidGraph):
        load_model(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64e6
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    "node",
    [
        helper.make_node("MatMul", ["pose", "pose"], ["unused"]),
        helper.make_node("MatMul", ["column", "pose"], ["unused"]),
        helper.make_node("Gemm", ["pose", "pose"], ["unused"], transB=1),
        helper.make_node("Gemm", ["pose", "pose"], ["unused"], transA=1),
        helper.make_node("Concat", ["pose", "pose"], ["unused"], axis=0),
        helper.make_node("Add", ["pose", "nowhere"], ["unused"]),
        helper.make_node("Add", ["pose", "pose"], ["features"]),
        helper.make_node("Add", ["pose", "pose"], ["pose"]),
    ],
)
def test_a_node_whose_size_is_not_known(tmp_path: Path, node: onnx.NodeProto) -> None:
    def change(model: onnx.ModelProto) -> None:
        chained("Neg", "pose", 0)(model)
        with_node(model, node)

    with pytest.raises(errors.InvalidGraph):
        load_model(altered(tmp_path / "model.onnx", change))


@pytest.mark.parametrize("name", [WEIGHT, "pose"])
def test_two_tensors_of_one_name(tmp_path: Path, name: str) -> None:
    """Which of them is used would depend on the reader."""

    def change(model: onnx.ModelProto) -> None:
        model.graph.initializer.append(numpy_helper.from_array(np.ones((1, 7)), name))

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == name


def test_more_references_than_can_be_compared_in_time(tmp_path: Path) -> None:
    references = json.loads(entry(onnx.load_model_from_string(PACKAGED), "reference_poses").value)
    path = with_entry(tmp_path / "model.onnx", "reference_poses", references * 9)
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(path)
    assert caught.value.key == "reference_poses"
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(with_entry(path, "design", "d" * 2_000_000))
    assert caught.value.key == "design"


@pytest.mark.process
def test_a_model_is_served_without_the_library_onnx() -> None:
    """Another process, since this one has it."""
    program = (
        "import sys; sys.modules['onnx'] = None; "
        "from annik_core.model.artifact import load_model; load_model('gantry')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def if_node(*initializers: TensorProto) -> onnx.NodeProto:
    """An ``If`` with tensors that only its branches have."""
    branch = helper.make_graph(
        [helper.make_node("Identity", [initializers[0].name], ["chosen"])],
        "branch",
        [],
        [helper.make_tensor_value_info("chosen", TensorProto.DOUBLE, None)],
        list(initializers),
    )
    return helper.make_node("If", ["pose"], ["unused"], then_branch=branch, else_branch=branch)


NAN = numpy_helper.from_array(np.array([np.nan]), "hidden")
SPARSE = helper.make_sparse_tensor(
    numpy_helper.from_array(np.array([1.0]), "values"),
    numpy_helper.from_array(np.array([0]), "indices"),
    [3],
)


@pytest.mark.parametrize(
    "node",
    [
        if_node(NAN),
        helper.make_node("RandomNormalLike", ["pose"], ["unused"]),
        helper.make_node("Telepathy", ["pose"], ["unused"]),
        helper.make_node("Gelu", ["pose"], ["unused"], domain="com.microsoft"),
        helper.make_node("Add", ["pose", "pose"], ["unused"], domain="mine"),
    ],
    ids=lambda node: node.op_type,
)
def test_an_operator_that_no_model_uses(tmp_path: Path, node: onnx.NodeProto) -> None:
    path = altered(tmp_path / "model.onnx", lambda model: with_node(model, node))
    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(path)
    assert caught.value.part == ".".join(filter(None, (node.domain, node.op_type)))


@pytest.mark.parametrize(
    "attribute",
    [
        helper.make_attribute("then_branch", if_node(NAN).attribute[0].g),
        helper.make_attribute("branches", [if_node(NAN).attribute[0].g]),
        helper.make_attribute("sparse_value", SPARSE),
        helper.make_attribute("values", [NAN]),
        helper.make_attribute("values", [SPARSE]),
    ],
)
def test_an_attribute_that_hides_weights(tmp_path: Path, attribute: onnx.AttributeProto) -> None:
    """Even where it claims to be a number."""
    for kind in (attribute.type, onnx.AttributeProto.INT):
        node = helper.make_node("Constant", [], ["unused"])
        changed = node.attribute.add()
        changed.CopyFrom(attribute)
        changed.type = kind
        path = altered(tmp_path / "model.onnx", lambda model, node=node: with_node(model, node))
        with pytest.raises(errors.InvalidGraph) as caught:
            load_model(path)
        assert caught.value.part == attribute.name


@pytest.mark.parametrize(
    "constant", [{"value": NAN}, {"value_float": np.nan}, {"value_floats": [0.0, np.inf]}]
)
def test_a_constant_that_is_not_finite(tmp_path: Path, constant: dict[str, Any]) -> None:
    node = helper.make_node("Constant", [], ["unused"], **constant)
    path = altered(tmp_path / "model.onnx", lambda model: with_node(model, node))
    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(path)
    assert caught.value.part in ("hidden", *constant)


def test_a_function_in_the_model(tmp_path: Path) -> None:
    def change(model: onnx.ModelProto) -> None:
        body = [helper.make_node("Identity", ["x"], ["y"])]
        model.functions.append(
            helper.make_function("mine", "F", ["x"], ["y"], body, model.opset_import)
        )

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == "functions"


def test_a_sparse_weight(tmp_path: Path) -> None:
    path = altered(
        tmp_path / "model.onnx", lambda model: model.graph.sparse_initializer.append(SPARSE)
    )
    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(path)
    assert caught.value.part == "sparse_initializer"


@pytest.mark.parametrize("kind", [999, TensorProto.FLOAT16, TensorProto.STRING])
def test_a_tensor_of_a_type_that_no_model_uses(tmp_path: Path, kind: int) -> None:
    def change(model: onnx.ModelProto) -> None:
        weight(model).data_type = kind

    with pytest.raises(errors.InvalidGraph) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.part == WEIGHT


def test_an_entry_that_is_there_twice(tmp_path: Path) -> None:
    """Another reader might take the other one."""

    def change(model: onnx.ModelProto) -> None:
        model.metadata_props.add(key="annik.seed", value="1")

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == "seed"
    assert "more than once" in caught.value.problem


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999", "9" * 400])
@pytest.mark.parametrize("key", ["evaluation", "fit_options", "robot"])
def test_a_number_in_the_metadata_that_is_not_finite(
    tmp_path: Path, key: str, number: str
) -> None:
    """JSON has none; Python's reader would take it."""

    def change(model: onnx.ModelProto) -> None:
        entry(model, key).value = f'{{"deep": [{number}]}}'

    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(altered(tmp_path / "model.onnx", change))
    assert caught.value.key == key
    assert number[:20] in caught.value.problem


def test_metadata_that_is_not_finite_is_not_written() -> None:
    metadata = load_model(default_model_path()).metadata
    with pytest.raises(ValueError, match="JSON"):
        replace(metadata, evaluation={"examples": np.nan}).to_properties()


@pytest.mark.parametrize("number", ["0.3", True, [[0.3]]])
def test_a_number_of_the_metadata_of_another_type(tmp_path: Path, number: object) -> None:
    rows = json.loads(entry(onnx.load_model_from_string(PACKAGED), "reference_poses").value)
    rows[0][0] = number
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(with_entry(tmp_path / "model.onnx", "reference_poses", rows))
    assert caught.value.key == "reference_poses"


@pytest.mark.parametrize("change", [{"kind": []}, {"kind": {}}, {"name": 7}, {"joints": [[]]}])
def test_a_malformed_robot(tmp_path: Path, gantry: Robot, change: dict[str, Any]) -> None:
    path = with_entry(tmp_path / "model.onnx", "robot", {**gantry.definition, **change})
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(path)
    assert caught.value.key == "robot"


def test_a_path_that_can_not_be(tmp_path: Path) -> None:
    with pytest.raises(errors.ModelNotFound):
        load_model(f"{tmp_path}/model\0.onnx")


def test_whatever_the_checks_did_not_foresee(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any exception of the libraries that read the bytes is an error that names the file."""

    def surprise(*_: object) -> None:
        raise AttributeError("a library's bug\non two lines")

    monkeypatch.setattr(artifact_module, "_robot", surprise)
    with pytest.raises(errors.UnreadableModel) as caught:
        load_model(default_model_path())
    assert caught.value.path == default_model_path()
    assert "a library's bug" in caught.value.problem
    assert "\n" not in str(caught.value)


class FakeSession:
    """A session whose output for a single pose is chosen by the test."""

    def __init__(self, session: Any, alone: Callable[[Any], Any]) -> None:
        self._session = session
        self._alone = alone
        self.get_inputs = session.get_inputs
        self.get_outputs = session.get_outputs

    def run(self, names: list[str], feed: dict[str, Any]) -> list[Any]:
        answer = self._session.run(names, feed)[0]
        return [self._alone(answer) if len(answer) == 1 else answer]


def fail(_: Any) -> Any:
    raise RuntimeError("[ONNXRuntimeError] Non-zero status code\nsecond line")


FAILURES = pytest.mark.parametrize(
    "alone",
    [fail, lambda a: a[0], lambda a: np.tile(a, (8, 1)), lambda a: a[:, :5], np.float32],
    ids=["raises", "flat", "of a batch", "a joint short", "single precision"],
)


@FAILURES
def test_a_network_that_fails_while_it_serves(alone: Callable[[Any], Any]) -> None:
    """The target is refused and counted; the service goes on."""
    artifact = load_model(default_model_path())
    pose = np.array(artifact.metadata.reference_poses[0])
    failing = replace(artifact, session=FakeSession(artifact.session, alone), after_features=None)
    with pytest.raises(errors.NetworkFailed) as caught:
        failing.joint_positions(pose[np.newaxis])
    assert caught.value.path == default_model_path()
    result = IkServer(IkSolver(failing)).solve(pose)
    assert result.status is IkStatus.SOLVER_FAILED
    assert "\n" not in result.reason


@FAILURES
def test_a_network_that_takes_batches_only(
    monkeypatch: pytest.MonkeyPatch, alone: Callable[[Any], Any]
) -> None:
    original = artifact_module.make_session
    monkeypatch.setattr(
        artifact_module, "make_session", lambda *given: FakeSession(original(*given), alone)
    )
    with pytest.raises(errors.NetworkFailed):
        load_model(default_model_path())


def test_a_network_that_computes_one_pose_differently(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    original = artifact_module.make_session
    monkeypatch.setattr(
        artifact_module,
        "make_session",
        lambda *given: FakeSession(original(*given), lambda answer: answer + 1e-8),
    )
    with pytest.raises(errors.InvalidMetadata) as caught:
        load_model(default_model_path())
    assert caught.value.key == "reference_joint_positions"


def test_another_robot_of_the_same_name(gantry: Robot) -> None:
    """The definition decides, not the name; the hashes tell which is which."""
    other = robot_from_definition({**gantry.definition, "base_frame": "world"}, "test")
    with pytest.raises(RobotMismatch) as caught:
        load_model(default_model_path(), other)
    for found, robot in ((caught.value.found, gantry), (caught.value.expected, other)):
        assert robot.definition_hash[:12] in found


def test_the_model_of_another_robot(gantry: Robot) -> None:
    """Both robots are named."""
    other = robot_from_definition({**gantry.definition, "name": "portal"}, "test")
    with pytest.raises(RobotMismatch) as caught:
        load_model(default_model_path(), other)
    assert caught.value.found.startswith("gantry ")
    assert caught.value.expected.startswith("portal ")

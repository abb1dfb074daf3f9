"""Fewer layers answer as all of them do. Needs no ROS."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto
from onnx.helper import make_graph, make_model, make_node, make_opsetid, make_tensor_value_info

from annik_core.model.artifact import default_model_path, make_session
from annik_core.model.session import with_linear_layers
from annik_core.pose import FloatArray

RNG = np.random.default_rng(5)
CONSTANTS = {
    "row": RNG.uniform(0.5, 2.0, 3),
    "other": RNG.uniform(0.5, 2.0, 3),
    "one": np.array([2.0]),
    "scalar": np.array(2.0),
    "weights": RNG.normal(size=(4, 3)),
    "biases": RNG.normal(size=4),
    "back": RNG.normal(size=(3, 4)),
}


def chain(*nodes: tuple[str, ...], **attributes: object) -> onnx.ModelProto:
    """A model of operators with the constants that follow each; the attributes are a Gemm's."""
    made = [
        make_node(
            operator,
            [f"t{index}", *constants],
            [f"t{index + 1}"],
            **(({"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 1} | attributes)
            if operator == "Gemm" else {}),
        )
        for index, (operator, *constants) in enumerate(nodes)
    ]  # fmt: skip
    graph = make_graph(
        made,
        "chain",
        [make_tensor_value_info("t0", TensorProto.DOUBLE, ["n", 3])],
        [make_tensor_value_info(f"t{len(nodes)}", TensorProto.DOUBLE, ["n", None])],
        [onnx.numpy_helper.from_array(value, name) for name, value in CONSTANTS.items()],
    )
    return make_model(graph, opset_imports=[make_opsetid("", 17)], ir_version=8)


def answers(model: onnx.ModelProto) -> FloatArray:
    """To some rows."""
    session = make_session(model.SerializeToString(), default_model_path())
    rows = np.random.default_rng(1).normal(size=(5, 3))
    answer: FloatArray = session.run(None, {"t0": rows})[0]
    return answer


LAYER = ("Gemm", "weights", "biases")
LAYER_BACK = ("Gemm", "back", "row")


@pytest.mark.parametrize(
    ("nodes", "operators"),
    [
        ([("Sub", "row"), ("Div", "other"), LAYER, ("Tanh",)], "Gemm Tanh"),
        ([LAYER, ("Tanh",), LAYER_BACK, ("Mul", "other"), ("Add", "row")], "Gemm Tanh Gemm"),
        ([LAYER, LAYER_BACK], "Gemm"),
        ([("Tanh",), ("Mul", "row")], "Tanh Gemm"),
        ([("Tanh",), ("Tanh",)], "Tanh Tanh"),
    ],
)
def test_a_shorter_chain_answers_as_the_chain(
    nodes: list[tuple[str, ...]], operators: str
) -> None:
    """Each run of linear operators is one layer."""
    model = chain(*nodes)
    shorter = with_linear_layers(model)
    assert shorter is not None
    assert " ".join(node.op_type for node in shorter.graph.node) == operators
    np.testing.assert_allclose(answers(shorter), answers(model), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    "model",
    [
        chain(("Abs",), LAYER),
        chain(("Mul", "one")),
        chain(("Mul", "scalar")),
        chain(("Mul", "one"), LAYER),
        chain(("Mul", "t0")),
        chain(("Gemm", "row"), transB=0),
        chain(LAYER, ("Tanh",), LAYER_BACK, alpha=2.0),
        chain(LAYER, LAYER),
        chain(("Gemm", "weights", "one"), LAYER_BACK),
    ],
)
def test_what_is_no_chain_of_layers_stays(model: onnx.ModelProto) -> None:
    """It is run as it is."""
    assert with_linear_layers(model) is None


def test_constants_before_the_row_are_not_taken_for_those_behind_it() -> None:
    """A constant minus a row is no row minus a constant."""
    model = chain(("Sub", "row"))
    model.graph.node[0].input[:] = ["row", "t0"]
    assert with_linear_layers(model) is None

"""The exported file computes what was trained, says what it is, and needs no annik. ROS-free."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from annik_core.dataset import Dataset
from annik_core.errors import NotWritable
from annik_core.installation import default_model_path
from annik_core.model.artifact import load_model
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.evaluation import evaluation_dataset, network_errors
from annik_training.export import (
    EXPORT_TOLERANCE,
    ExportMismatch,
    export_model,
    prove_export,
)
from annik_training.fitting.fit import FittedNetwork, fit
from annik_training.fitting.options import FitOptions
from annik_training.networks.network import InverseKinematicsNetwork
from annik_training.training import train

OPTIONS = FitOptions(restarts=1, max_evaluations=10, seed=3)


@pytest.fixture(scope="module")
def dataset(gantry: Robot) -> Dataset:
    return generate_dataset(gantry, "thirty_phase", 3, seed=3)


@pytest.fixture(scope="module")
def fitted(dataset: Dataset) -> FittedNetwork:
    return fit(dataset, OPTIONS)


@pytest.fixture(scope="module")
def exported(
    dataset: Dataset, fitted: FittedNetwork, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("export") / "deep" / "model.onnx"
    unseen = evaluation_dataset(dataset.robot, 5000, OPTIONS.seed)
    evaluation = network_errors(fitted.network.joint_positions, unseen).summary()
    export_model(fitted, evaluation, path)
    return path


@pytest.mark.parametrize("batch", [1, 2, 7, 1000])
def test_exported_equals_trained(
    gantry: Robot, fitted: FittedNetwork, exported: Path, batch: int
) -> None:
    """To 1e-9, with nothing but onnxruntime on the other side."""
    poses = random_dataset(gantry, gantry.joint_box, batch, seed=batch).poses
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    answer = session.run(None, {"pose": poses})[0]
    assert answer.dtype == np.float64
    assert answer == pytest.approx(fitted.network.joint_positions(poses), abs=1e-9, rel=0)


def test_exported_equals_trained_on_the_gimbal_edge(
    dataset: Dataset, fitted: FittedNetwork, exported: Path
) -> None:
    artifact = load_model(exported)
    answer = artifact.joint_positions(dataset.poses)
    expected = fitted.network.joint_positions(dataset.poses)
    assert answer == pytest.approx(expected, abs=1e-9, rel=0)


def test_every_number_in_the_graph_is_double_precision(exported: Path) -> None:
    """The exporter likes to store constants in single precision; only the estimate may be."""
    model = onnx.load(exported)
    single = [
        tensor.name
        for tensor in model.graph.initializer
        if tensor.data_type == onnx.TensorProto.FLOAT
    ]
    assert single == []


def test_the_file_says_how_it_was_made(
    dataset: Dataset, fitted: FittedNetwork, exported: Path
) -> None:
    metadata = load_model(exported).metadata
    assert metadata.design == "thirty_phase"
    assert metadata.design_options == {"size": 3}
    assert metadata.examples == 102
    assert metadata.held_out_examples == 15
    assert metadata.dataset_hash == dataset.content_hash
    assert metadata.seed == 3
    assert metadata.fit_options == OPTIONS.to_dict()
    assert set(metadata.evaluation["position_error_m"]) == {"rms", "p50", "p95", "p99", "max"}
    properties = {p.key: p.value for p in onnx.load(exported).metadata_props}
    assert all(json.loads(value) is not None for value in properties.values())


def test_the_file_names_no_path_of_the_machine(exported: Path) -> None:
    """The exporter would leave its stack traces in it."""
    content = exported.read_bytes()
    for trace in (b"/site-packages/", b"/annik_training/", b".py"):
        assert trace not in content


def test_a_graph_that_computes_something_else_is_not_written(
    fitted: FittedNetwork, exported: Path
) -> None:
    """The check that stands between a bug of the exporter and a robot."""
    poses = fitted.dataset.poses
    expected = fitted.network.joint_positions(poses)
    prove_export(exported.read_bytes(), poses, expected, EXPORT_TOLERANCE, exported)
    for wrong in (expected + 1e-7, np.full_like(expected, np.nan)):
        with pytest.raises(ExportMismatch) as caught:
            prove_export(exported.read_bytes(), poses, wrong, EXPORT_TOLERANCE, exported)
        assert caught.value.path == exported
        assert caught.value.tolerance == EXPORT_TOLERANCE
        assert not caught.value.difference < 0.99e-7


@pytest.mark.slow
def test_export_proves_the_file_before_it_writes(
    fitted: FittedNetwork, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An exporter that gets one bias wrong leaves no file."""
    right = fitted.network.as_onnx()

    def wrong(network: object) -> onnx.ModelProto:
        bias = next(t for t in right.graph.initializer if t.name == "output.bias")
        array = onnx.numpy_helper.to_array(bias) + 1e-7
        bias.CopyFrom(onnx.numpy_helper.from_array(array, bias.name))
        return right

    monkeypatch.setattr(InverseKinematicsNetwork, "as_onnx", wrong)
    unseen = evaluation_dataset(fitted.dataset.robot, 500, 0)
    evaluation = network_errors(fitted.network.joint_positions, unseen).summary()
    with pytest.raises(ExportMismatch):
        export_model(fitted, evaluation, tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_training_evaluates_on_poses_it_was_not_trained_on(
    dataset: Dataset, tmp_path: Path
) -> None:
    result = train(dataset, tmp_path / "model.onnx", OPTIONS)
    unseen = evaluation_dataset(dataset.robot, 5000, OPTIONS.seed)
    errors = network_errors(result.fitted.network.joint_positions, unseen)
    assert result.evaluation == errors.summary()
    assert len(unseen) == result.evaluation.examples == 5000
    assert not set(map(tuple, unseen.poses)) & set(map(tuple, dataset.poses))


@pytest.mark.slow
def test_a_linear_path_is_exported(gantry: Robot, dataset: Dataset, tmp_path: Path) -> None:
    """Beside the hidden layers; a node accepts the file, which says how it was fitted."""
    options = replace(OPTIONS, max_evaluations=1, linear_path=True, held_out_fraction=0.0)
    fitted = fit(dataset, options)
    with torch.no_grad():
        # The gantry would need no hidden layers any more.
        fitted.network.network.output.weight.fill_(0.01)
    unseen = evaluation_dataset(gantry, 500, 0)
    path = tmp_path / "model.onnx"
    errors = network_errors(fitted.network.joint_positions, unseen)
    export_model(fitted, errors.summary(), path)
    artifact = load_model(path)
    answer = artifact.joint_positions(unseen.poses)
    assert answer == pytest.approx(fitted.network.joint_positions(unseen.poses), abs=1e-9, rel=0)
    assert 1e-3 < np.abs(answer - unseen.joint_positions).max() < 0.5
    assert artifact.metadata.held_out_examples == 0
    assert artifact.metadata.fit_options == options.to_dict()


def test_a_place_that_can_not_be_written(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("exists")
    with pytest.raises(NotWritable) as caught:
        train(dataset, tmp_path / "file" / "model.onnx", OPTIONS)
    assert caught.value.path == tmp_path / "file"


@pytest.mark.slow
def test_the_packaged_model_is_what_its_command_makes(gantry: Robot, tmp_path: Path) -> None:
    """``annik train --robot gantry --design thirty_phase --steps 6 --out models/gantry.onnx``.

    The weights may differ from machine to machine, since rounding differs and the fit magnifies
    it; the examples, the options and what the network answers may not.
    """
    dataset = generate_dataset(gantry, "thirty_phase", 6, seed=0)
    result = train(dataset, tmp_path / "gantry.onnx", FitOptions())
    packaged, made = load_model(default_model_path()), load_model(result.path)
    assert made.metadata.dataset_hash == packaged.metadata.dataset_hash
    assert made.metadata.fit_options == packaged.metadata.fit_options
    poses = random_dataset(gantry, gantry.joint_box, 2000, seed=77).poses
    difference = np.abs(made.joint_positions(poses) - packaged.joint_positions(poses))
    # 1e-4 rad of a drive is 0.06 mm.
    assert difference.max() < 1e-4

"""Datasets: a round trip keeps everything, and a damaged file is refused. ROS-free."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from annik_core.errors import DatasetError, UnreadableDataset
from annik_core.robot import Robot
from annik_training.dataset import Dataset, compute_dataset, load_dataset, save_dataset


@pytest.fixture(scope="module")
def dataset(gantry: Robot) -> Dataset:
    return compute_dataset(gantry, "thirty_phase", 3, seed=5)


@pytest.fixture(scope="module")
def saved(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dataset") / "gantry.npz"
    save_dataset(dataset, path)
    return path


def test_round_trip(dataset: Dataset, saved: Path) -> None:
    loaded = load_dataset(saved)
    assert np.array_equal(loaded.joint_positions, dataset.joint_positions)
    assert np.array_equal(loaded.poses, dataset.poses)
    assert loaded.provenance == dataset.provenance
    assert loaded.content_hash == dataset.content_hash
    assert loaded.robot.definition_hash == dataset.robot.definition_hash


def test_any_program_can_read_it(dataset: Dataset, saved: Path) -> None:
    """Plain arrays in NumPy's own format."""
    with np.load(saved) as archive:
        assert archive["poses"].shape == (102, 7)
        assert archive["joint_positions"] == pytest.approx(dataset.joint_positions)


@settings(max_examples=50)
@given(st.data())
def test_a_truncated_file_is_refused(
    saved: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = saved.read_bytes()
    length = data.draw(st.integers(0, len(content) - 1))
    cut = tmp_path_factory.mktemp("cut") / "cut.npz"
    cut.write_bytes(content[:length])
    with pytest.raises(UnreadableDataset, match=r"cut\.npz"):
        load_dataset(cut)


def test_an_altered_number_is_noticed(dataset: Dataset, tmp_path: Path) -> None:
    """Even one that the zip's own checksum agrees with."""
    path = tmp_path / "altered.npz"
    save_dataset(dataset, path)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["poses"][7, 0] += 1e-12
    np.savez(path, **arrays)
    with pytest.raises(UnreadableDataset, match="altered"):
        load_dataset(path)


def test_another_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, weights=np.zeros(3))
    with pytest.raises(UnreadableDataset, match="not a dataset"):
        load_dataset(path)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UnreadableDataset, match="no such file"):
        load_dataset(tmp_path / "none.npz")


def test_a_folder_that_is_not_there(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="can't be written"):
        save_dataset(dataset, tmp_path / "no" / "where.npz")


def test_same_seed_same_content(gantry: Robot, dataset: Dataset) -> None:
    again = compute_dataset(gantry, "thirty_phase", 3, seed=5)
    assert again.content_hash == dataset.content_hash
    assert compute_dataset(gantry, "thirty_phase", 4, seed=5).content_hash != again.content_hash

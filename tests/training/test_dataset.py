"""Datasets: a round trip keeps everything, and a damaged file is refused. ROS-free."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from annik_core.dataset import Dataset, UnreadableDataset, load_dataset, save_dataset
from annik_core.errors import NotWritable
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset


@pytest.fixture(scope="module")
def dataset(gantry: Robot) -> Dataset:
    return generate_dataset(gantry, "thirty_phase", 3, seed=5)


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


def refused(path: Path, reason: str = "") -> None:
    """Assert that a file can't be loaded, for a reason that matches."""
    with pytest.raises(UnreadableDataset) as caught:
        load_dataset(path)
    assert caught.value.path == path
    assert re.search(reason, caught.value.reason), caught.value.reason


@settings(max_examples=50)
@given(st.data())
def test_a_truncated_file_is_refused(
    saved: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = saved.read_bytes()
    length = data.draw(st.integers(0, len(content) - 1))
    cut = tmp_path_factory.mktemp("cut") / "cut.npz"
    cut.write_bytes(content[:length])
    refused(cut)


def test_an_altered_number_is_noticed(dataset: Dataset, tmp_path: Path) -> None:
    """Even one that the zip's own checksum agrees with."""
    path = tmp_path / "altered.npz"
    save_dataset(dataset, path)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["poses"][7, 0] += 1e-12
    np.savez(path, **arrays)
    refused(path, "altered")


def test_another_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, weights=np.zeros(3))
    refused(path, "not a dataset")


@settings(max_examples=200)
@given(st.data())
def test_flipped_bytes_are_refused_or_change_nothing(
    dataset: Dataset, saved: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Wherever they are: in the zip's directory, in a header of NumPy's, in a number."""
    content = bytearray(saved.read_bytes())
    # The headers and the directory are a small part of the file and the most fragile one.
    starts = [content.find(b"PK\x03\x04", at) for at in range(0, len(content), 512)]
    places = st.sampled_from([at for at in starts if at >= 0]).flatmap(
        lambda start: st.integers(start, min(start + 200, len(content) - 1))
    ) | st.integers(0, len(content) - 1)
    flips = data.draw(st.lists(st.tuples(places, st.integers(1, 255)), min_size=1, max_size=4))
    for place, bits in flips:
        content[place] ^= bits
    flipped = tmp_path_factory.mktemp("flipped") / "flipped.npz"
    flipped.write_bytes(content)
    try:
        loaded = load_dataset(flipped)
    except UnreadableDataset:
        return
    # Such as the time of day that the zip keeps of each of its files.
    assert loaded.content_hash == dataset.content_hash


def with_provenance(dataset: Dataset, path: Path, provenance: Any) -> Path:
    """Save a dataset with another provenance, and the hash that fits it."""
    digest = hashlib.sha256(json.dumps(provenance, sort_keys=True).encode())
    for array in (dataset.joint_positions, dataset.poses):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(array.tobytes())
    np.savez(
        path,
        joint_positions=dataset.joint_positions,
        poses=dataset.poses,
        provenance=np.array(json.dumps(provenance)),
        sha256=np.array(digest.hexdigest()),
    )
    return path


def test_the_helper_of_these_tests_makes_files_that_load(dataset: Dataset, tmp_path: Path) -> None:
    path = with_provenance(dataset, tmp_path / "same.npz", dataset.provenance)
    assert load_dataset(path).content_hash == dataset.content_hash


@pytest.mark.parametrize("key", ["design", "design_options", "seed", "source", "robot"])
def test_a_provenance_that_lacks_something_is_refused(
    dataset: Dataset, tmp_path: Path, key: str
) -> None:
    provenance = {name: value for name, value in dataset.provenance.items() if name != key}
    refused(with_provenance(dataset, tmp_path / "lacks.npz", provenance), f"lacks '{key}'")


@pytest.mark.parametrize("provenance", [[], ["design"], "text", 1, None])
def test_a_provenance_that_is_no_mapping_is_refused(
    dataset: Dataset, tmp_path: Path, provenance: Any
) -> None:
    refused(with_provenance(dataset, tmp_path / "list.npz", provenance), "not a mapping")


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"design": 3}, "'design' is 3"),
        ({"design_options": []}, "'design_options' is"),
        ({"seed": "0"}, "'seed' is '0'"),
        ({"seed": True}, "'seed' is True"),
        ({"source": None}, "'source' is None"),
        ({"robot": {}}, "robot can't be used"),
        ({"robot": {"kind": []}}, "robot can't be used"),
        ({"robot_hash": "0" * 64}, "'robot_hash' is '000"),
        ({"joint_names": ["a", "b"]}, "'joint_names' is"),
        ({"units": {}}, "'units' is"),
        ({"format_version": 2}, "format version 2, not 1"),
    ],
)
def test_a_provenance_that_contradicts_itself_is_refused(
    dataset: Dataset, tmp_path: Path, changes: Mapping[str, Any], complaint: str
) -> None:
    path = tmp_path / "changed.npz"
    refused(with_provenance(dataset, path, {**dataset.provenance, **changes}), complaint)


def _set(name: str, row: int, column: int, value: float) -> Callable[[Dataset], Dataset]:
    def change(dataset: Dataset) -> Dataset:
        array = getattr(dataset, name).copy()
        array[row, column] = value
        return dataclasses.replace(dataset, **{name: array})

    return change


def _replace(name: str, change: Callable[[Any], Any]) -> Callable[[Dataset], Dataset]:
    return lambda dataset: dataclasses.replace(dataset, **{name: change(getattr(dataset, name))})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (_set("joint_positions", 3, 1, np.nan), "row 3 of joint_positions holds a number"),
        (_set("poses", 4, 6, np.inf), "row 4 of poses holds a number"),
        (_replace("joint_positions", lambda a: a[:, :5]), r"shape \(102, 5\), not \(n, 6\)"),
        (_replace("poses", lambda a: a[:, :6]), r"poses have shape \(102, 6\)"),
        (_replace("poses", lambda a: a[0]), r"poses have shape \(7,\)"),
        (_replace("poses", lambda a: a[:-1]), "102 joint positions but 101 poses"),
        (_replace("poses", lambda a: a.astype(np.float32)), "poses are float32"),
        (_replace("joint_positions", lambda a: a.astype(">f8")), "joint_positions are >f8"),
        (_replace("joint_positions", lambda a: a.astype(str)), "joint_positions are <U"),
        (_set("poses", 5, 6, 1.1), "row 5 of poses: the quaternion's norm"),
        (_set("poses", 5, 6, 1e308), "row 5 of poses: the quaternion's norm"),
        (_set("joint_positions", 6, 5, 99.0), "row 6 .* yaw_drive_joint would be 99"),
        (_set("poses", 7, 0, 0.123), "row 7 of poses is .* m and 0 rad from"),
        (_set("poses", 7, 0, 1e308), "row 7 of poses is inf m"),
        (_replace("poses", lambda a: a + np.eye(1, 7) * 2e-9), "row 0 of poses is 2e-09 m"),
        (_replace("poses", lambda a: a[::-1].copy()), "row 0 of poses is"),
    ],
)
def test_wrong_content_with_a_hash_that_fits_is_refused(
    dataset: Dataset, tmp_path: Path, change: Callable[[Dataset], Dataset], complaint: str
) -> None:
    path = tmp_path / "wrong.npz"
    save_dataset(change(dataset), path)
    refused(path, complaint)


def test_a_dataset_without_examples_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    empty = dataclasses.replace(dataset, joint_positions=np.zeros((0, 6)), poses=np.zeros((0, 7)))
    save_dataset(empty, tmp_path / "empty.npz")
    refused(tmp_path / "empty.npz", "no examples")


def test_measured_poses_may_differ_from_the_forward_kinematics(
    dataset: Dataset, tmp_path: Path
) -> None:
    poses = dataset.poses + np.array([1e-3, 0, 0, 0, 0, 0, 0])
    measured = dataclasses.replace(dataset, poses=poses, source="measured")
    save_dataset(measured, tmp_path / "measured.npz")
    loaded = load_dataset(tmp_path / "measured.npz")
    assert np.array_equal(loaded.poses, poses)
    assert loaded.source == "measured"


def test_rounding_of_another_processor_is_no_contradiction(
    dataset: Dataset, tmp_path: Path
) -> None:
    nearly = dataclasses.replace(dataset, poses=dataset.poses * (1 + 1e-14))
    save_dataset(nearly, tmp_path / "nearly.npz")
    assert len(load_dataset(tmp_path / "nearly.npz")) == len(dataset)


def test_a_folder_is_no_dataset(tmp_path: Path) -> None:
    refused(tmp_path, "can't be read")


def test_a_missing_file(tmp_path: Path) -> None:
    refused(tmp_path / "none.npz", "no such file")


def test_a_folder_that_is_not_there(dataset: Dataset, tmp_path: Path) -> None:
    path = tmp_path / "no" / "where.npz"
    with pytest.raises(NotWritable) as caught:
        save_dataset(dataset, path)
    assert caught.value.path == path


def test_same_seed_same_content(gantry: Robot, dataset: Dataset) -> None:
    again = generate_dataset(gantry, "thirty_phase", 3, seed=5)
    assert again.content_hash == dataset.content_hash
    assert generate_dataset(gantry, "thirty_phase", 4, seed=5).content_hash != again.content_hash

"""Files that never end, that unpack to gigabytes, or that are no files: a clean error, soon."""

from __future__ import annotations

import io
import json
import os
import socket
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from support.bounded import MEGABYTE, bounded

from annik_core.append_log import AppendLog
from annik_core.dataset import UnreadableDataset, load_dataset, save_dataset
from annik_core.errors import AnnikError, DamagedRecord, InvalidValue, NotWritable
from annik_core.files import bounded_yaml
from annik_core.model.artifact import load_model
from annik_core.model.errors import ModelError, UnreadableModel
from annik_core.model.metadata import ModelMetadata
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import load_robot
from annik_core.simulation.imperfections import InvalidImperfections, read_imperfections
from annik_core.target_paths import UnreadableTargetFile, csv_path
from annik_ros.launch_arguments import checked_arguments, node_parameters
from annik_training.calibration.errors import UnreadableMeasurements
from annik_training.calibration.measurement_files import read_measurements
from annik_training.designs.registry import generate_dataset
from msg_tools.bags.errors import BagNotReadable
from msg_tools.bags.reader import read_bag

READERS: dict[str, tuple[Callable[[Path], object], type[AnnikError]]] = {
    "dataset": (load_dataset, UnreadableDataset),
    "targets": (csv_path, UnreadableTargetFile),
    "robot": (load_robot, InvalidRobotDefinition),
    "imperfections": (lambda path: read_imperfections(path, ur5e()), InvalidImperfections),
    "measurements": (lambda path: read_measurements(ur5e(), [path]), UnreadableMeasurements),
    "journal": (AppendLog, NotWritable),
    "model": (load_model, UnreadableModel),
    "bag": (read_bag, BagNotReadable),
    "parameters": (lambda path: node_parameters(str(path), ["/node"]), InvalidValue),
    "launched model": (lambda path: checked_arguments({"model": str(path)}), InvalidValue),
    "launched targets": (
        lambda path: checked_arguments({"path": "csv", "csv_file": str(path)}),
        UnreadableTargetFile,
    ),
}
YAML_READERS = ("robot", "imperfections", "parameters")


def ur5e():
    return load_robot("ur5e")


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def unix_socket(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # the name of a socket has at most 107 bytes
    try:
        socket.socket(socket.AF_UNIX).bind(path.name)
    finally:
        os.chdir(before)


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("make", [pipe, endless_device, unix_socket, folder])
def test_what_is_no_regular_file_is_refused_at_once(
    reader: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    read, error = READERS[reader]
    make(tmp_path / "input")
    with bounded(), pytest.raises(error):
        read(tmp_path / "input")


@pytest.mark.parametrize("reader", ["dataset", "targets", "robot", "imperfections", "journal"])
def test_a_file_of_a_terabyte_is_refused_at_once(reader: str, tmp_path: Path) -> None:
    read, error = READERS[reader]
    path = tmp_path / "input"
    path.touch()
    os.truncate(path, 10**12)  # takes no space on the disk
    with bounded(), pytest.raises(error):
        read(path)


LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{level}: &a{level} [{', '.join(9 * [f'*a{level - 1}'])}]\n" for level in range(1, 12)
)
MERGES = "a0: &a0 {x: 1}\n" + "".join(
    f"a{level}: &a{level} {{<<: [{', '.join(9 * [f'*a{level - 1}'])}]}}\n"
    for level in range(1, 12)
)
YAML_BOMBS = {
    "aliases": LAUGHS,
    "merged": MERGES,
    "alias of itself": "a: &a [*a]",
    "brackets": 100_000 * "[",
    "dashes": 5_000 * "- ",
    "sixties": "a: 1" + 200_000 * ":1",
    "digits": "a: 0x" + 200_000 * "f",
}


@pytest.mark.parametrize("reader", YAML_READERS)
@pytest.mark.parametrize("bomb", YAML_BOMBS)
def test_yaml_that_grows_is_refused(reader: str, bomb: str, tmp_path: Path) -> None:
    read, error = READERS[reader]
    (tmp_path / "input").write_text(YAML_BOMBS[bomb])
    with bounded(), pytest.raises(error):
        read(tmp_path / "input")


def test_yaml_that_names_a_thing_twice_is_read() -> None:
    assert bounded_yaml("a: &a {x: [1, 2]}\nb: *a\nc: {<<: *a}") == {
        name: {"x": [1, 2]} for name in "abc"
    }


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("hostile") / "dataset.npz"
    save_dataset(generate_dataset(load_robot("gantry"), "thirty_phase", 2, seed=1), path)
    return path


def npy_header(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": descr, "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def altered(dataset: Path, path: Path, name: str, blocks: Callable[[], Iterator[bytes]]) -> Path:
    """A copy of a dataset with another member, compressed."""
    with zipfile.ZipFile(dataset) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for member in old.namelist():
            with new.open(member, "w") as file:
                for block in blocks() if member == name else [old.read(member)]:
                    file.write(block)
    return path


def zeros(megabytes: int) -> Iterator[bytes]:
    yield npy_header((megabytes * MEGABYTE // 56, 7))
    yield from (bytes(MEGABYTE) for _ in range(megabytes))


@pytest.mark.parametrize("name", ["poses.npy", "unknown.npy"])
def test_a_dataset_that_unpacks_to_gigabytes_is_refused(
    dataset: Path, tmp_path: Path, name: str
) -> None:
    bomb = altered(dataset, tmp_path / "bomb.npz", "poses.npy", lambda: zeros(300))
    if name != "poses.npy":
        with zipfile.ZipFile(bomb, "a") as archive:
            archive.writestr(name, b"")
    with bounded(100), pytest.raises(UnreadableDataset):
        load_dataset(bomb)


@pytest.mark.parametrize(
    "header",
    [npy_header((10**12, 7)), npy_header((), "<U900000000"), npy_header((10**15,), "|V0")],
)
@pytest.mark.parametrize("name", ["poses.npy", "provenance.npy"])
def test_a_dataset_whose_arrays_claim_more_than_they_have_is_refused(
    dataset: Path, tmp_path: Path, name: str, header: bytes
) -> None:
    path = altered(dataset, tmp_path / "claims.npz", name, lambda: iter([header]))
    with bounded(), pytest.raises(UnreadableDataset):
        load_dataset(path)


@pytest.mark.parametrize("depth", [500, 900, 950, 980, 100_000])
def test_json_that_is_nested_deeply_is_refused(dataset: Path, tmp_path: Path, depth: int) -> None:
    nested = f'{{"seed": {depth * "["}{depth * "]"}}}'
    provenance = io.BytesIO()
    np.save(provenance, np.array(nested))
    path = altered(
        dataset, tmp_path / "deep.npz", "provenance.npy", lambda: iter([provenance.getvalue()])
    )
    journal = tmp_path / "deep.journal.jsonl"
    journal.write_text(nested + "\n")
    with bounded():
        with pytest.raises(UnreadableDataset):
            load_dataset(path)
        with pytest.raises(DamagedRecord):
            AppendLog(journal)
        with pytest.raises(ModelError):
            ModelMetadata.from_properties({"annik.format_version": nested}, path)


def test_a_line_of_many_numbers_is_no_record(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_text(json.dumps({"check": "", "order": [0] * 1000}) + "\n" + "9" * 5000 + "\n")
    with bounded(), pytest.raises(DamagedRecord):
        AppendLog(journal)

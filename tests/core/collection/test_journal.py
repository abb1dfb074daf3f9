"""What was measured survives whatever ends the process, and belongs to one plan. ROS-free."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.collection_plans import small_plan
from support.processes import run_python

from annik_core.collection.journal import (
    CollectionJournal,
    JournalMismatch,
    MeasuredExample,
    journal_path,
    open_journal,
)
from annik_core.collection.settings import CollectionSettings
from annik_core.dataset import MEASURED, load_dataset, save_dataset
from annik_core.errors import DamagedRecord, InUse, NotWritable
from annik_core.pose import checked_pose

SAMPLES = 4
ORDER = (3, 0, 4, 1, 2)


@pytest.fixture(scope="module")
def plan(gantry):
    return small_plan(gantry)


def example(plan, row: int) -> MeasuredExample:
    """Numbers that differ in every digit from row to row."""
    rng = np.random.default_rng(row)
    pose = plan.poses[row].copy()
    pose[:3] += rng.normal(0, 1e-4, 3)
    return MeasuredExample(
        row, checked_pose(pose), tuple(rng.uniform(0, 1e-7, 2)), plan.joint_positions[row]
    )


def written(path: Path, plan, rows=ORDER) -> bytes:
    with CollectionJournal(path, plan, SAMPLES) as journal:
        journal.begin(ORDER, CollectionSettings())
        for row in rows:
            journal.record(example(plan, row))
    return path.read_bytes()


def same(one: MeasuredExample, other: MeasuredExample) -> bool:
    return (
        one.row == other.row
        and one.square_sums == other.square_sums
        and (one.pose == other.pose).all()
        and (one.joint_positions == other.joint_positions).all()
    )


@given(st.integers(0, 10_000))
def test_of_a_journal_that_was_cut_off_anywhere_the_whole_lines_are_left(
    plan, tmp_path_factory, length
) -> None:
    """A prefix of its examples, to the last bit; and it goes on from there."""
    path = tmp_path_factory.mktemp("journal") / "journal.jsonl"
    data = written(path, plan)
    kept = data[: length % (len(data) + 1)]
    path.write_bytes(kept)
    with CollectionJournal(path, plan, SAMPLES) as journal:
        lines = kept.count(b"\n")
        assert (journal.order == ORDER) if lines else (journal.order is None)
        assert tuple(journal.examples) == ORDER[: max(lines - 1, 0)]
        assert all(same(found, example(plan, row)) for row, found in journal.examples.items())
        if journal.order is None:
            journal.begin(ORDER, CollectionSettings())
        for row in journal.remaining:
            journal.record(example(plan, row))
        assert journal.is_complete
    assert path.read_bytes() == data


@given(st.permutations(range(5)), st.integers(1, 5))
def test_the_dataset_does_not_depend_on_the_order_of_the_measurements(
    plan, tmp_path_factory, rows, count
) -> None:
    """In the rows of the plan, with its joint positions; the same file to the last bit."""
    folder = tmp_path_factory.mktemp("journal")
    files = []
    for number, some in enumerate((rows[:count], sorted(rows[:count]))):
        path = folder / f"{number}.jsonl"
        written(path, plan, some)
        with CollectionJournal(path, plan, SAMPLES) as journal:
            save_dataset(journal.dataset(), folder / f"{number}.npz")
        files.append((folder / f"{number}.npz").read_bytes())
    assert files[0] == files[1]
    dataset = load_dataset(folder / "0.npz")
    expected = sorted(rows[:count])
    assert (dataset.joint_positions == plan.joint_positions[expected]).all()
    assert (dataset.poses == [example(plan, row).pose for row in expected]).all()
    assert dataset.source == MEASURED
    assert dataset.measurement_noise is not None
    assert (dataset.design, dataset.seed) == (plan.design, plan.seed)


def test_a_journal_of_another_plan_or_another_number_of_samples_is_refused(
    gantry, plan, tmp_path
) -> None:
    path = tmp_path / "journal.jsonl"
    written(path, plan)
    other = small_plan(gantry, seed=1)
    with pytest.raises(JournalMismatch) as caught:
        CollectionJournal(path, other, SAMPLES)
    assert caught.value.journal == plan.content_hash
    assert caught.value.given == other.content_hash
    with pytest.raises(JournalMismatch) as caught:
        CollectionJournal(path, plan, 5)
    assert (caught.value.what, caught.value.journal, caught.value.given) == ("samples", 4, 5)
    # It was only looked at.
    with CollectionJournal(path, plan, SAMPLES) as journal:
        assert journal.is_complete


@pytest.mark.parametrize("line", range(6))
def test_an_altered_line_is_refused_with_its_number(plan, tmp_path, line) -> None:
    path = tmp_path / "journal.jsonl"
    lines = written(path, plan).splitlines(keepends=True)
    lines[line] = lines[line].replace(b"0", b"1", 1)
    path.write_bytes(b"".join(lines))
    with pytest.raises(DamagedRecord) as caught:
        CollectionJournal(path, plan, SAMPLES)
    assert (caught.value.path, caught.value.line) == (path, line + 1)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"row": 5}, "row 5"),
        ({"row": 3}, "row 3 a second time"),
        ({"row": True}, "row True"),
        ({"pose": [1.0, 2.0]}, "shape"),
        ({"pose": ["a"] * 7}, "not numbers"),
        ({"joint_positions": [1.0]}, "1 joint positions"),
        ({"square_sums": [-1.0, 0.0]}, "negative"),
    ],
)
def test_a_line_that_is_no_example_of_the_plan_is_refused(plan, tmp_path, change, problem) -> None:
    """Though its checksum is right."""
    path = tmp_path / "journal.jsonl"
    written(path, plan, ORDER[:1])
    with CollectionJournal(path, plan, SAMPLES) as journal:
        other = example(plan, 0)
        line = {
            "row": 0,
            "pose": other.pose.tolist(),
            "square_sums": list(other.square_sums),
            "joint_positions": other.joint_positions.tolist(),
        }
        journal._log.append({**line, **change})
    with pytest.raises(DamagedRecord) as caught:
        CollectionJournal(path, plan, SAMPLES)
    assert caught.value.line == 3
    assert problem in caught.value.problem


def test_a_file_that_is_no_journal_is_refused(plan, tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_text(json.dumps({"mine": 1}) + "\n")
    with pytest.raises(DamagedRecord) as caught:
        CollectionJournal(path, plan, SAMPLES)
    assert caught.value.line == 1
    assert json.loads(path.read_text()) == {"mine": 1}


@pytest.mark.process
def test_a_journal_is_open_once_and_its_lock_goes_with_the_process(plan, tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    with CollectionJournal(path, plan, SAMPLES), pytest.raises(InUse) as caught:
        CollectionJournal(path, plan, SAMPLES)
    assert caught.value.path == path
    # A process that is killed while it has it open.
    script = (
        "import os, sys; from pathlib import Path\n"
        "from annik_core.append_log import AppendLog\n"
        f"log = AppendLog(Path({str(path)!r}))\n"
        "print('open', flush=True); os.kill(os.getpid(), 9)"
    )
    killed = run_python("-c", script)
    assert killed.stdout == "open\n"
    CollectionJournal(path, plan, SAMPLES).close()


def test_a_folder_that_cannot_be_made_is_an_error_with_a_remedy(plan, tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NotWritable) as caught:
        CollectionJournal(tmp_path / "file" / "journal.jsonl", plan, SAMPLES)
    assert caught.value.path == tmp_path / "file" / "journal.jsonl"


def test_a_dataset_without_a_journal_is_not_overwritten(plan, tmp_path) -> None:
    dataset = tmp_path / "measured.npz"
    dataset.write_bytes(b"of somebody else")
    with pytest.raises(NotWritable) as caught:
        open_journal(dataset, plan, SAMPLES)
    assert caught.value.path == dataset
    assert list(tmp_path.iterdir()) == [dataset]


def test_the_journal_is_beside_its_dataset(tmp_path) -> None:
    assert journal_path(tmp_path / "a.b.npz") == tmp_path / "a.b.journal.jsonl"


def test_reading_it_again_finds_what_was_written_before_an_interruption(plan, tmp_path) -> None:
    path = tmp_path / "journal.jsonl"
    with CollectionJournal(path, plan, SAMPLES) as journal:
        journal.reload()
        assert journal.order is None
        journal.begin(ORDER, CollectionSettings())
        journal.record(example(plan, 3))
        journal.record(example(plan, 0))
        del journal.examples[0]
        journal.reload()
        assert tuple(journal.examples) == (3, 0)
        assert journal.order == ORDER

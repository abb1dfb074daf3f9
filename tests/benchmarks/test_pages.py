"""Pages of the documentation: those of the data beside them, and tables that are tables."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click import Command
from click.testing import CliRunner

from annik_core.errors import NotWritable
from benchmarks import learn_robot
from benchmarks.command_line import DOCS, output_folders, write_results
from benchmarks.conditions import Conditions
from benchmarks.ik.command import ik
from benchmarks.ik.results import BenchResults
from benchmarks.markdown import markdown_table
from benchmarks.node.command import node
from benchmarks.node.results import NodeBenchResults

BENCHMARKS = {"ik_bench": (ik, BenchResults), "node_bench": (node, NodeBenchResults)}


def with_tuples_as_lists(data: object) -> object:
    return json.loads(json.dumps(data))


@pytest.mark.parametrize("name", BENCHMARKS)
def test_data_of_the_documentation_are_read_back_whole(name: str) -> None:
    _, kind = BENCHMARKS[name]
    data = json.loads((DOCS / "results" / f"{name}.json").read_text(encoding="utf-8"))
    again = with_tuples_as_lists(kind.from_dict(data).to_dict())
    # What was not noted when it was measured has its default.
    assert {**data, "conditions": None} == {**again, "conditions": None}
    assert data["conditions"].items() <= again["conditions"].items()


@pytest.mark.parametrize("name", BENCHMARKS)
def test_the_page_of_the_documentation_is_that_of_its_data(name: str, tmp_path: Path) -> None:
    command: Command = BENCHMARKS[name][0]
    shutil.copytree(DOCS / "results", tmp_path / "results", ignore=shutil.ignore_patterns("*.md"))
    ran = CliRunner().invoke(command, ["--page-only", "--docs", str(tmp_path)])
    assert ran.exit_code == 0, ran.output
    page = (tmp_path / "results" / f"{name}.md").read_text(encoding="utf-8")
    assert page == (DOCS / "results" / f"{name}.md").read_text(encoding="utf-8")


def test_columns_of_numbers_are_aligned_to_the_right() -> None:
    lines = ["| a | b |", "| --- | ---: |", "| x | 1 |"]
    assert markdown_table(("a", "b"), [("x", "1")], 1).splitlines() == lines


def test_conditions_are_one_sentence() -> None:
    now = Conditions.now(("numpy", "no-such-library"), 0.5, "a middleware")
    sentence = str(now)
    assert sentence.startswith(f"{now.processor}, {now.cores} cores")
    assert "load 0.5 before and" in sentence
    assert "a middleware, numpy " in sentence
    assert "no-such-library" not in sentence
    assert sentence.endswith(".") and "\n" not in sentence


def test_the_folders_of_a_benchmark_are_made_and_checked(tmp_path: Path) -> None:
    out, docs = tmp_path / "out", tmp_path / "docs"
    assert output_folders(out, docs, "images") == [out, docs / "images"]
    assert (docs / "images").is_dir()
    write_results([out, docs / "images"], {"a.md": "text", "a.png": b"\x89"})
    assert (docs / "images" / "a.png").read_bytes() == b"\x89"
    assert (out / "a.md").read_text(encoding="utf-8") == "text"


def test_learn_robot_measures_nothing_for_a_folder_that_can_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learn_robot, "_robots", None)
    (tmp_path / "file").touch()
    arguments = ["--quick", "--out", str(tmp_path / "file" / "out")]
    with pytest.raises(NotWritable):
        learn_robot.learn_robot.main(arguments, standalone_mode=False)

"""Pages of the documentation: those of the data beside them, and tables that are tables."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click import Command
from click.testing import CliRunner

from benchmarks.command_line import DOCS
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
    (tmp_path / "results").mkdir()
    shutil.copy(DOCS / "results" / f"{name}.json", tmp_path / "results")
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

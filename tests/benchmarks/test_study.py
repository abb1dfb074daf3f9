"""Studies: which jobs they have, that nothing measured is lost, and what they write. ROS-free."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.processes import LONG_PATIENCE, Process, is_group_gone, run_python, wait_until

from annik_core.errors import DamagedRecord, InUse, InvalidValue, NotWritable
from annik_core.installation import share_directory
from annik_core.robots.errors import UnknownRobot
from annik_training.designs.registry import DESIGNS, Needs, make_design
from annik_training.errors import UnsupportedRobot
from annik_training.evaluation import ErrorSummary
from benchmarks.jobs.fit_job import FitOutcome
from benchmarks.study import command as study_command
from benchmarks.study import job as study_job
from benchmarks.study.figures import efficiency_figure
from benchmarks.study.grid import nearest_sizes, study_grid
from benchmarks.study.job import JobFailure, try_fit_job
from benchmarks.study.page import command, figure_name
from benchmarks.study.results import StudyResults
from benchmarks.study.settings import StudySettings
from benchmarks.study.summary import (
    Spread,
    SummaryRow,
    best_within,
    error_text,
    fewest_reaching,
    summarise,
)
from benchmarks.study.training_options import TRAINING_MEANINGS, TRAINING_OPTIONS
from benchmarks.systems.library import load_system

TINY = StudySettings(
    systems=("elbow_arm", "gantry"),
    designs=("thirty_phase", "workspace_grid", "sobol"),
    training=("plain", "linear_path"),
    examples=(8, 24),
    seeds=2,
    max_evaluations=2,
)
TINY_OPTIONS = tuple(command(TINY).split()[2:])
#: Enough jobs that a study can be stopped half-way.
# Each job takes some tenths of a second: long enough that a signal comes in time.
LONG_OPTIONS = (
    *("--systems", "elbow_arm", "--designs", "sobol,random", "--training", "plain,bayesian"),
    *("--examples", "128", "--seeds", "5", "--max-evaluations", "80"),
)
LONG_JOBS = 20


def study(folder: Path, *options: object) -> Result:
    arguments = ["--out", folder, *options]
    return CliRunner().invoke(study_command.study, [str(argument) for argument in arguments])


def lines(folder: Path) -> list[dict[str, Any]]:
    text = (folder / "results.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def summary(folder: Path) -> list[dict[str, str]]:
    """The summary without the times."""
    with (folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        return [
            {name: value for name, value in row.items() if name != "seconds_median"}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tiny study, in this process; not to be written to."""
    folder = tmp_path_factory.mktemp("study")
    result = study(folder, *TINY_OPTIONS, "--workers", 1, "--docs", folder / "docs")
    assert result.exit_code == 0, result.output
    return folder


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "study"))


# --- which jobs -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("design", "system", "asked", "counts"),
    [
        ("thirty_phase", "gantry", (16, 32, 64, 128), (42, 59, 119)),
        ("thirty_phase_plus", "gantry", (100,), (118,)),
        ("workspace_grid", "gantry", (16, 32, 64, 128), (32, 108)),
        ("central_composite", "elbow_arm", (16, 32, 64), (15, 29, 71)),
        ("sobol", "F", (16, 8), (8, 16)),
    ],
)
def test_sizes_are_those_of_the_nearest_numbers_of_examples(design, system, asked, counts):
    subject = load_system(system)
    sizes = nearest_sizes(design, subject, asked)
    assert tuple(len(make_design(subject, design, size, 0)) for size in sizes) == counts


def test_a_design_that_can_t_be_made_for_a_system():
    with pytest.raises(UnsupportedRobot):
        nearest_sizes("workspace_grid", load_system("F"), (16,))


def test_jobs_are_every_combination_that_makes_sense():
    grid = study_grid(StudySettings(seeds=2))
    assert len(set(grid.jobs)) == len(grid.jobs)
    assert {job.design for job in grid.jobs if job.system == "gantry"} == {
        name for name, design in DESIGNS.items() if design.needs is not Needs.ARM
    }
    assert {job.training for job in grid.jobs} == set(TRAINING_OPTIONS)
    assert {job.seed for job in grid.jobs[: len(grid.jobs) // 2]} == {0}
    assert {job.options.seed for job in grid.jobs} == {0, 1}
    # Each is said once.
    assert grid.left_out == (
        "identifiability for gantry: it is no arm with a URDF",
        "workspace_grid for F: it has no workspace to divide",
        "identifiability for F: it is no arm with a URDF",
        "thirty_phase_plus for elbow_arm: the examples of thirty_phase",
        "workspace_grid for elbow_arm: it has no workspace to divide",
        "identifiability for elbow_arm: it is no arm with a URDF",
    )


@pytest.mark.parametrize(
    ("settings", "name", "value"),
    [
        ({"designs": ("star",)}, "design", "star"),
        ({"training": ("adam",)}, "training", "adam"),
        ({"systems": ()}, "systems", ()),
        ({"examples": (16, 16)}, "examples", (16, 16)),
        ({"examples": (1,)}, "examples", 1),
        ({"seeds": 0}, "seeds", 0),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, name, value):
    with pytest.raises(InvalidValue) as raised:
        StudySettings(**settings)
    assert (raised.value.name, raised.value.value) == (name, value)


def test_a_system_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(InvalidValue) as raised:
        study_grid(StudySettings(systems=("arm",)))
    assert (raised.value.name, raised.value.value) == ("systems", "arm")
    assert "F, elbow_arm" in raised.value.allowed
    assert isinstance(raised.value.__cause__, UnknownRobot)


def test_the_command_on_the_page_gives_its_settings(tmp_path: Path, monkeypatch):
    received = {}

    def run_study(settings: StudySettings, *_: object) -> None:
        received["settings"] = settings
        raise KeyboardInterrupt

    monkeypatch.setattr("benchmarks.study.run.run_study", run_study)
    study(tmp_path, *TINY_OPTIONS)
    assert received["settings"] == TINY
    assert command(StudySettings()) == "./run study"
    study(tmp_path, "--quick", "--seeds", 3)
    assert received["settings"].seeds == 3
    assert received["settings"].examples == StudySettings.quick().examples


def test_help_says_what_the_defaults_are():
    text = " ".join(study(Path(), "--help").output.split())
    standard = StudySettings()
    for name in (*DESIGNS, *TRAINING_OPTIONS):
        assert name in text
    for values in (standard.systems, standard.examples):
        assert f"default {','.join(map(str, values))}." in text
    assert f"combination (default {standard.seeds})." in text
    assert f"per fit (default {standard.max_evaluations})." in text


# --- from end to end --------------------------------------------------------------------------


def test_a_study_writes_summary_page_and_figures(finished: Path):
    grid = study_grid(TINY)
    assert len(lines(finished)) == len(grid.jobs)
    rows = summary(finished)
    assert len(rows) * TINY.seeds == len(grid.jobs)
    for row in rows:
        assert row["seeds"] == str(TINY.seeds)
        assert row["unit"] == "mm"
        for error in ("rms_error", "max_error"):
            least, median, greatest = (
                float(row[f"{error}_{which}"]) for which in ("min", "median", "max")
            )
            assert 0 <= least <= median <= greatest
        assert float(row["rms_error_max"]) <= float(row["max_error_max"])
    for folder in (finished, finished / "docs"):
        page = (folder / "study.md").read_text(encoding="utf-8")
        assert command(TINY) in page
        assert "workspace_grid for elbow_arm" in page
        pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", page)
        assert pictures == ["images/study_elbow_arm.png", "images/study_gantry.png"]
        for picture in pictures:
            assert (folder / picture).read_bytes().startswith(b"\x89PNG")


def test_nothing_is_run_twice(copied: Path, monkeypatch):
    monkeypatch.setattr("benchmarks.study.run.try_fit_job", None)
    before = (copied / "results.jsonl").read_bytes()
    result = study(copied, *TINY_OPTIONS, "--workers", 1)
    assert result.exit_code == 0, result.output
    jobs = len(study_grid(TINY).jobs)
    assert f"{jobs} of {jobs} jobs were done before" in result.output
    assert (copied / "results.jsonl").read_bytes() == before


def test_results_of_other_settings_are_kept_and_not_used(copied: Path):
    before = summary(copied)
    options = (*TINY_OPTIONS, "--max-evaluations", "1", "--workers", 1)
    assert study(copied, *options).exit_code == 0
    assert len(lines(copied)) == 2 * len(study_grid(TINY).jobs)
    assert summary(copied) != before
    assert study(copied, *TINY_OPTIONS, "--workers", 1).exit_code == 0
    assert summary(copied) == before


# --- what happens to studies ------------------------------------------------------------------


#: Sums are rounded otherwise where threads share them; worker processes have one each.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def long_study(folder: Path, workers: int) -> tuple[str, ...]:
    """The arguments of a study of some seconds."""
    out = ("--out", str(folder), "--workers", str(workers))
    return ("-m", "benchmarks.study", *LONG_OPTIONS, *out)


def start(folder: Path, workers: int) -> Process:
    """A real study in a process group of its own, which is well under way.

    A worker that is still loading its modules says so if a signal ends it: each must be at work.
    """
    results = folder / "results.jsonl"
    finished = results.read_bytes().count(b"\n")
    command = (sys.executable, *long_study(folder, workers))
    process = Process(*command, log=folder / "log", environment=ONE_THREAD)
    wait_until(
        lambda: (
            results.read_bytes().count(b"\n") >= finished + 4 * workers or not process.is_running
        ),
        "some finished jobs of each worker",
    )
    assert process.is_running, process.log
    return process


@pytest.fixture(scope="module")
def stopped_twice(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """A study that Ctrl-C ended, then kill -9, and that was then let alone."""
    folder = tmp_path_factory.mktemp("stopped")
    (folder / "results.jsonl").touch()
    seen: dict[str, Any] = {"folder": folder}
    processes = []
    try:
        processes.append(start(folder, workers=2))
        processes[0].signal_group(signal.SIGINT)
        seen["interrupted_code"] = processes[0].wait_for_exit()
        seen["interrupted_says"] = processes[0].log
        seen["interrupted_lines"] = len(lines(folder))
        wait_until(lambda: is_group_gone(processes[0].pid), "the end of the workers")

        # In one process, to save loading everything in three.
        processes.append(start(folder, workers=1))
        processes[1].signal(signal.SIGKILL)
        processes[1].wait_for_exit()
        seen["killed_lines"] = (folder / "results.jsonl").read_bytes().count(b"\n")

        command = long_study(folder, 1)
        last = run_python(*command, environment=ONE_THREAD, patience=LONG_PATIENCE)
        assert last.returncode == 0, last.stderr
        seen["last_says"] = last.stderr
        yield seen
    finally:
        for process in processes:
            process.kill()


@pytest.mark.process
@pytest.mark.slow
def test_ctrl_c_is_one_line_and_an_exit_code(stopped_twice: dict[str, Any]):
    assert stopped_twice["interrupted_code"] == 130
    text = stopped_twice["interrupted_says"]
    assert "Traceback" not in text and "Error" not in text
    (line,) = [line for line in text.splitlines() if line.startswith("annik: ")]
    done = stopped_twice["interrupted_lines"]
    assert (
        line == f"annik: stopped; {done} of {LONG_JOBS} jobs done; run the same command to go on"
    )
    assert 2 <= done < LONG_JOBS


@pytest.mark.process
@pytest.mark.slow
def test_kill_9_loses_nothing_and_nothing_is_run_again(stopped_twice: dict[str, Any]):
    before = stopped_twice["killed_lines"]
    assert stopped_twice["interrupted_lines"] + 2 <= before < LONG_JOBS
    assert f"{before} of {LONG_JOBS} jobs were done before" in stopped_twice["last_says"]
    found = lines(stopped_twice["folder"])
    assert len(found) == LONG_JOBS
    assert len({json.dumps(line["job"], sort_keys=True) for line in found}) == LONG_JOBS


@pytest.mark.slow
def test_a_stopped_study_finds_what_one_that_was_not_finds(
    stopped_twice: dict[str, Any], tmp_path: Path
):
    command = long_study(tmp_path, 1)
    last = run_python(*command, environment=ONE_THREAD, patience=LONG_PATIENCE)
    assert last.returncode == 0, last.stderr
    assert summary(stopped_twice["folder"]) == summary(tmp_path)


def test_a_last_line_that_is_not_whole_is_cut_off_and_run_again(copied: Path):
    path = copied / "results.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    result = study(copied, *TINY_OPTIONS, "--workers", 1)
    assert result.exit_code == 0, result.output
    assert "was incomplete" in result.output
    assert path.read_bytes().splitlines()[:-1] == whole.splitlines()[:-1]
    assert lines(copied)[-1]["job"] == json.loads(whole.splitlines()[-1])["job"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda line: line[:50],
        lambda line: b"",
        lambda line: b"\xff\x00" + line,
        lambda line: line.replace(b'"rms": ', b'"rms": 1'),
        lambda line: line.replace(b'"seed": 0', b'"seed": 9'),
        lambda line: b"[1, 2]",
        lambda line: b'{"job": 1}',
    ],
)
def test_a_damaged_line_is_named(copied: Path, damage):
    path = copied / "results.jsonl"
    before = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([*before[:2], damage(before[2]), *before[3:]]) + b"\n")
    damaged = path.read_bytes()
    result = study(copied, *TINY_OPTIONS, "--workers", 1)
    assert isinstance(result.exception, DamagedRecord)
    assert (result.exception.path, result.exception.line) == (path, 3)
    assert "delete this line" in str(result.exception)
    assert path.read_bytes() == damaged


def test_one_study_at_a_time(copied: Path):
    with StudyResults(copied):
        result = study(copied, *TINY_OPTIONS)
        assert isinstance(result.exception, InUse)
        assert str(copied) in str(result.exception)
    assert study(copied, *TINY_OPTIONS, "--workers", 1).exit_code == 0


def test_a_full_disk_leaves_whole_lines(copied: Path, monkeypatch):
    path = copied / "results.jsonl"
    whole = path.read_bytes()
    written = []

    def write_a_part(descriptor: int, data: bytes) -> int:
        if written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(real_write(descriptor, data[:20]))
        return written[0]

    real_write = os.write
    job = study_grid(TINY).jobs[0]
    with StudyResults(copied) as results:
        monkeypatch.setattr(os, "write", write_a_part)
        with pytest.raises(NotWritable) as raised:
            results.record(job, JobFailure("none"))
        monkeypatch.undo()
    assert raised.value.path == path
    assert raised.value.reason == os.strerror(errno.ENOSPC)
    assert written == [20]
    assert path.read_bytes() == whole


def test_a_folder_that_can_t_be_written(tmp_path: Path):
    (tmp_path / "file").touch()
    result = study(tmp_path / "file" / "study", *TINY_OPTIONS)
    assert isinstance(result.exception, NotWritable)


def test_a_job_that_fails_is_recorded_and_tried_again(tmp_path: Path):
    options = (
        *("--systems", "elbow_arm", "--designs", "active,random", "--training", "plain"),
        *("--examples", 2001, "--seeds", 1, "--max-evaluations", 1, "--workers", 1),
    )
    for run in (1, 2):
        result = study(tmp_path, *options)
        assert result.exit_code == 0, result.output
        assert "1 of 2 jobs failed" in result.output
        assert "active 2001, plain, seed 0: InvalidValue" in " ".join(result.output.split())
        # The random one was run once.
        assert [line["job"]["design"] for line in lines(tmp_path)].count("random") == 1
        assert len([line for line in lines(tmp_path) if "failure" in line]) == run
        assert "is 2001; allowed: 1 to 2000" in (tmp_path / "study.md").read_text(encoding="utf-8")


def test_a_study_of_which_every_job_failed_is_a_fault(tmp_path: Path):
    options = (
        *("--systems", "elbow_arm", "--designs", "active", "--training", "plain"),
        *("--examples", 2001, "--seeds", 1, "--workers", 1),
    )
    result = study(tmp_path, *options)
    assert result.exit_code == 1
    assert isinstance(result.exception, study_command.EveryJobFailed)
    assert result.exception.jobs == 1


@pytest.mark.parametrize(
    "fault", [np.linalg.LinAlgError("singular"), FloatingPointError("overflow"), RuntimeError("?")]
)
def test_a_numerical_fault_is_a_failure(fault: Exception, monkeypatch):
    def fail(_: object) -> None:
        raise fault

    monkeypatch.setattr(study_job, "run_fit_job", fail)
    failure = try_fit_job(study_grid(TINY).jobs[0])
    assert failure == JobFailure(f"{type(fault).__name__}: {fault}")


def test_a_network_that_answers_nan_is_a_failure(monkeypatch):
    nothing = FitOutcome(8, 0.0, ErrorSummary(*[float("nan")] * 5), 1.0)
    monkeypatch.setattr(study_job, "run_fit_job", lambda _: nothing)
    assert isinstance(try_fit_job(study_grid(TINY).jobs[0]), JobFailure)


def test_a_fault_of_the_program_is_not_hidden(monkeypatch):
    def fail(_: object) -> None:
        raise TypeError

    monkeypatch.setattr(study_job, "run_fit_job", fail)
    with pytest.raises(TypeError):
        try_fit_job(study_grid(TINY).jobs[0])


def test_another_robot_under_the_same_path_is_another_job(tmp_path: Path):
    definition = tmp_path / "robot.yaml"
    text = (share_directory() / "robots" / "gantry.yaml").read_text(encoding="utf-8")
    definition.write_text(text, encoding="utf-8")
    settings = StudySettings(systems=(str(definition),), designs=("sobol",), training=("plain",))
    job = study_grid(settings).jobs[0]
    with StudyResults(tmp_path) as results:
        results.record(job, JobFailure("first"))
        assert results.outcome(job) == JobFailure("first")
    definition.write_text(text.replace("name: gantry", "name: other", 1), encoding="utf-8")
    load_system.cache_clear()
    with StudyResults(tmp_path) as results:
        assert results.outcome(job) is None


# --- what they say ----------------------------------------------------------------------------


def row(design: str, examples: int, error: float, training: str = "plain") -> SummaryRow:
    spread = Spread(error, error / 2, error * 2)
    return SummaryRow("F", design, training, examples, 3, "", spread, spread, 1.0)


def test_the_best_within_a_number_of_examples():
    rows = [row("sobol", 16, 3.0), row("random", 32, 1.0), row("active", 64, 0.1)]
    assert best_within(rows, 8) is None
    assert best_within(rows, 40) == rows[1]
    assert best_within(rows, 64) == rows[2]


def test_of_errors_that_are_none_the_fewest_examples_win():
    rows = [row("sobol", 32, 1e-14), row("random", 16, 1e-12), row("active", 8, 1e-3)]
    assert best_within(rows, 32) == rows[1]
    assert fewest_reaching(rows, 1e-13) == rows[1]


def test_the_fewest_examples_that_reach_an_error():
    rows = [row("sobol", 16, 3.0), row("random", 16, 2.0), row("active", 64, 0.1)]
    assert fewest_reaching(rows, 2.5) == rows[1]
    assert fewest_reaching(rows, 1.0) == rows[2]


def test_medians_and_ranges_are_over_the_seeds():
    jobs = [
        job
        for job in study_grid(StudySettings(systems=("F",), seeds=3)).jobs
        if (job.design, job.size, job.training) == ("sobol", 16, "plain")
    ]
    outcomes = {
        job: FitOutcome(16, 0.0, ErrorSummary(error, 0.0, 0.0, 0.0, 2 * error), error)
        for job, error in zip(jobs, (3.0, 1.0, 8.0), strict=True)
    }
    (found,) = summarise(outcomes)
    assert found.rms_error == Spread(3.0, 1.0, 8.0)
    assert found.max_error == Spread(6.0, 2.0, 16.0)
    assert (found.seeds, found.seconds, found.unit) == (3, 3.0, "")


@pytest.mark.parametrize(
    ("error", "text"),
    [(123.4, "120"), (12.0, "12"), (0.01234, "0.012"), (1.23e-5, "1.2e-05"), (0.0, "< 1e-06")],
)
def test_errors_have_two_digits(error: float, text: str):
    assert error_text(error) == text


def test_designs_differ_in_colour_and_in_grey():
    rows = [
        row(design, examples, 1.0 / examples, training)
        for design in DESIGNS
        for examples in (16, 64)
        for training in ("plain", "sobolev")
    ]
    figure = efficiency_figure(rows, (16, 64))
    plain, sobolev = figure.axes
    assert [axes.get_title() for axes in (plain, sobolev)] == ["plain", "sobolev"]
    assert plain.get_xscale() == plain.get_yscale() == "log"
    drawn = plain.get_lines()
    assert len(drawn) == len(DESIGNS)
    assert len({line.get_color() for line in drawn}) == len(DESIGNS)
    assert len({line.get_marker() for line in drawn}) == len(DESIGNS)
    # And one entry for the range.
    assert len(figure.legends[0].get_texts()) == len(DESIGNS) + 1


def test_the_legend_is_in_an_empty_place_if_there_is_one():
    rows = [row("sobol", 16, 1.0, training) for training in TRAINING_OPTIONS]
    figure = efficiency_figure(rows, (16,))
    assert figure.legends == []
    assert [axes.get_legend() is not None for axes in figure.axes] == [False] * 5 + [True]


def test_one_row_without_error_can_be_drawn():
    figure = efficiency_figure([row("sobol", 16, 0.0)], (16,))
    assert "below 1e-06" in figure.axes[0].texts[0].get_text()


def test_every_way_to_train_is_explained():
    assert tuple(TRAINING_MEANINGS) == tuple(TRAINING_OPTIONS)


def test_a_figure_s_name_is_a_file_name():
    assert figure_name("gantry") == "study_gantry.png"
    assert figure_name("../robots/my arm.yaml") == "study_robots-my-arm-yaml.png"

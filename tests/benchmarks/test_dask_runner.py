"""Jobs of a study on a Dask cluster of processes, of which one is killed. ROS-free."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from benchmarks.jobs.dask_runner import ClusterFailed, OtherVersion, run_jobs_on_dask
from benchmarks.study import command as study_command
from benchmarks.study.grid import study_grid
from benchmarks.study.run import StudyProgress, run_study
from benchmarks.study.settings import StudySettings

distributed = pytest.importorskip(
    "distributed", reason="it needs Dask: pip install 'annik_ros[study]'"
)
SETTINGS = StudySettings(
    systems=("elbow_arm",),
    designs=("sobol",),
    training=("plain",),
    examples=(16,),
    seeds=8,
    max_evaluations=10,
)


def results(folder: Path) -> dict[str, Any]:
    """The lines of the results file by their job, without the times."""
    lines = (folder / "results.jsonl").read_text(encoding="utf-8").splitlines()
    found = {}
    for line in map(json.loads, lines):
        line["outcome"].pop("seconds")
        found[json.dumps(line["job"], sort_keys=True)] = line["outcome"]
    assert len(found) == len(lines)
    return found


@pytest.mark.process
@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path):
    """The same results as in one process, whose jobs are in the same order or not."""
    jobs = len(study_grid(SETTINGS).jobs)
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path
    )
    killed: list[int] = []

    def kill_one_half_way(now: StudyProgress) -> None:
        if now.done == jobs // 2:
            with distributed.Client(cluster, set_as_default=False) as client:
                processes = sorted(client.run(os.getpid).values())
            assert len(set(processes)) == 2 and os.getpid() not in processes
            os.kill(processes[0], signal.SIGKILL)
            killed.append(processes[0])

    def on_cluster(function: Any, todo: Any) -> Any:
        return run_jobs_on_dask(function, todo, cluster.scheduler_address)

    with cluster:
        outcome = run_study(SETTINGS, tmp_path / "dask", on_cluster, kill_one_half_way)
    assert len(killed) == 1
    assert len(outcome.outcomes) == jobs
    assert not outcome.failures

    def in_this_process(function: Any, todo: Any) -> Any:
        from annik_training.fitting.levenberg_marquardt import one_thread

        with one_thread():
            yield from ((job, function(job)) for job in todo)

    run_study(SETTINGS, tmp_path / "here", in_this_process)
    assert results(tmp_path / "dask") == results(tmp_path / "here")


@pytest.mark.process
@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("benchmarks.jobs.dask_runner.TIMEOUT", 0.5)
    with pytest.raises(ClusterFailed) as caught:
        list(run_jobs_on_dask(abs, [1], "tcp://127.0.0.1:1"))
    assert caught.value.scheduler == "tcp://127.0.0.1:1"


@pytest.mark.parametrize(
    "options",
    [("--scheduler", "tcp://here:1"), ("--backend", "dask", "--scheduler", "x", "--workers", "2")],
)
def test_options_that_do_not_go_together_are_refused(options: tuple[str, ...]):
    assert CliRunner().invoke(study_command.study, options).exit_code == 2


def test_an_error_of_a_worker_comes_back_whole():
    import pickle

    error = pickle.loads(pickle.dumps(OtherVersion("tcp://there:1", "0.1", "0.2")))
    assert (error.worker, error.version, error.expected) == ("tcp://there:1", "0.1", "0.2")

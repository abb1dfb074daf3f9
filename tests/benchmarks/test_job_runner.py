"""Jobs in processes: all come back, and no process stays behind. ROS-free."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import joblib
import pytest
from support.processes import ROOT, Process, is_group_gone, wait_until

from benchmarks.jobs.job_runner import WorkerEnded, run_jobs

#: Runs jobs that take long and say which process they are in.
PROGRAM = """
import sys, time
from pathlib import Path
from benchmarks.jobs.job_runner import run_jobs

def job(number):
    Path(sys.argv[0]).parent.joinpath(f"worker_{number}").touch()
    time.sleep(60)

if __name__ == "__main__":
    for outcome in run_jobs(job, range(4), workers=2):
        pass
"""


def square(number: int) -> int:
    return number**2


def end_at_two(number: int) -> int:
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.process
@pytest.mark.parametrize("workers", [1, 2])
def test_each_job_comes_with_its_outcome(workers: int):
    assert dict(run_jobs(square, range(5), workers)) == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["threading", "multiprocessing"])
def test_another_backend_can_take_over(backend: str):
    """Ray's is one of multiprocessing, and gives no outcome before the last."""
    with joblib.parallel_config(backend=backend, n_jobs=2):
        outcomes = dict(run_jobs(square, range(20), 2))
    assert outcomes == {number: number**2 for number in range(20)}


@pytest.mark.process
def test_a_worker_that_is_killed_is_said():
    with pytest.raises(WorkerEnded, match="memory"):
        list(run_jobs(end_at_two, range(4), 2))


@pytest.mark.process
def test_workers_end_with_a_program_that_is_killed(tmp_path: Path):
    """What Ctrl-C does is tested with the study."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    process = Process(
        *(sys.executable, str(program)),
        log=tmp_path / "program.log",
        environment={"PYTHONPATH": str(ROOT)},
    )
    try:
        wait_until(
            lambda: not process.is_running or len(list(tmp_path.glob("worker_*"))) >= 2,
            "both workers",
        )
        assert process.is_running, process.log
        process.signal(signal.SIGKILL)
        process.wait_for_exit()
        wait_until(lambda: is_group_gone(process.pid), "the end of the workers")
    finally:
        process.kill()

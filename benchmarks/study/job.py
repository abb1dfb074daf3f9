"""A job of a study, whose failure is an outcome too."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from annik_core.errors import AnnikError, one_line
from benchmarks.jobs.fit_job import FitJob, FitOutcome, run_fit_job


@dataclass(frozen=True)
class JobFailure:
    """Why a job has no outcome.

    Attributes:
        reason: one line.
    """

    reason: str


def try_fit_job(job: FitJob) -> FitOutcome | JobFailure:
    """Run a job; a fault that annik knows, or of the arithmetic, must not stop the others.

    The seconds of the outcome are those of the processor: in a study jobs wait for each other,
    and for whatever else the machine has to do.
    """
    begin = time.process_time()
    try:
        outcome = run_fit_job(job)
    # NumPy, SciPy and torch report what can't be solved as ValueError or RuntimeError.
    except (AnnikError, ArithmeticError, ValueError, RuntimeError) as error:
        return JobFailure(f"{type(error).__name__}: {one_line(error)}")
    if not all(math.isfinite(value) for value in vars(outcome.error).values()):
        return JobFailure("the error of the fitted network is not finite")
    return replace(outcome, seconds=time.process_time() - begin)

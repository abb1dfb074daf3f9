"""``python -m benchmarks.study``."""

from benchmarks.command_line import run
from benchmarks.same_rounding import round_alike
from benchmarks.study.command import study

if __name__ == "__main__":
    round_alike()
    run(study, "./run study")

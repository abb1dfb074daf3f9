"""``python -m benchmarks.paper``."""

from benchmarks.command_line import run
from benchmarks.paper.command import paper
from benchmarks.same_rounding import round_alike

if __name__ == "__main__":
    round_alike()
    run(paper, "./run paper")

"""``python -m benchmarks.ik``."""

from benchmarks.command_line import run
from benchmarks.ik.command import ik

if __name__ == "__main__":
    run(ik, "./run bench ik")

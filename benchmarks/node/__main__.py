"""``python -m benchmarks.node``."""

from benchmarks.command_line import run
from benchmarks.node.command import node

if __name__ == "__main__":
    run(node, "./run bench node")

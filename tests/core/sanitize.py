"""Build the kernel with the address and undefined-behaviour sanitizers; run its tests and a fuzz.

``./run sanitize`` writes docs/results/sanitizers.md. What a sanitizer finds ends the process that
it watches, with a report, and this with exit code 1. The build is in build/sanitized.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from support.processes import ROOT
from support.source_tree import copy_of_the_tree

from annik_core.kernel.sources import sources_hash
from benchmarks.conditions import Conditions
from benchmarks.markdown import markdown_table

CALLS = 1_000_000
PAGE = ROOT / "docs" / "results" / "sanitizers.md"
SANITIZERS = "address,undefined,float-cast-overflow"
FLAGS = f"-O1 -g -D_GLIBCXX_ASSERTIONS -fsanitize={SANITIZERS} -fno-sanitize-recover=all"


def build(tree: Path) -> None:
    """Copy the checkout and build the kernel in the copy, if its sources are new."""
    copy_of_the_tree(tree)
    flags = {"CXXFLAGS": FLAGS, "LDFLAGS": f"-fsanitize={SANITIZERS}"}
    command = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
    subprocess.run(command, cwd=tree, env={**os.environ, **flags}, check=True)
    if not any((tree / "annik_core" / "kernel").glob("*.so")):
        sys.exit("the kernel was not built: it needs g++ with libasan and libubsan")


def watched(tree: Path) -> dict[str, str]:
    """The environment in which Python loads that kernel."""
    libraries = [
        subprocess.check_output(["g++", f"-print-file-name={name}"], text=True).strip()
        for name in ("libasan.so", "libstdc++.so")
    ]
    return {
        **os.environ,
        # Python is not built with them, so they are loaded first; leaks are mostly its own.
        "LD_PRELOAD": " ".join(libraries),
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",
        "PYTHONPATH": os.pathsep.join([str(tree), str(tree / "tests")]),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "ANNIK_KERNEL": "",
    }


def run(tree: Path, environment: Mapping[str, str], *command: str) -> str:
    """What a command prints; its errors end this."""
    result = subprocess.run(
        [sys.executable, *command], cwd=tree, env=environment, stdout=subprocess.PIPE, text=True
    )
    print(result.stdout, end="", flush=True)
    if result.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit code {result.returncode}")
    return result.stdout


def page(tree: Path, tests: str, counts: str, seed: int) -> str:
    """The page of the results, with the checksum of the sources that they are of."""
    checksum = sources_hash(tree / "annik_core" / "kernel")
    rows = [tuple(line.split()) for line in counts.splitlines()]
    total = sum(int(returned) + int(refused) for _, returned, refused in rows)
    table = markdown_table(
        ("call", "returned", "refused"),
        [(f"`{name}`", f"{int(a):,}", f"{int(b):,}") for name, a, b in rows],
        numbers=2,
    )
    return (
        "<!-- Written by ./run sanitize. -->\n"
        f"The kernel (SHA-256 of its sources {checksum[:12]}), built with "
        f"`-fsanitize={SANITIZERS}`: its {tests} tests pass, and {total:,} calls with right, "
        f"wrong and strange arguments (seed {seed}) return or raise. The sanitizers find "
        f"nothing.\n\n{table}\n\n{Conditions.now(('numpy', 'pybind11'))}\n"
    )


def main() -> None:
    """Build, test, fuzz; write the page if all options are the standard ones."""
    parser = argparse.ArgumentParser(description=__doc__, prog="./run sanitize")
    parser.add_argument("--calls", type=int, default=CALLS, help=f"default: {CALLS}")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    tree = ROOT / "build" / "sanitized"
    build(tree)
    environment = watched(tree)
    tests = run(tree, environment, "-m", "pytest", "-q", "-s", "tests/core/test_kernel.py")
    passed = re.search(r"(\d+) passed", tests)
    if passed is None or " skipped" in tests:
        sys.exit("not all tests were run")
    counts = run(
        *(tree, environment, "tests/support/kernel_fuzz.py"),
        *("--calls", str(options.calls), "--seed", str(options.seed)),
    )
    if (options.calls, options.seed) == (CALLS, 0):
        PAGE.write_text(page(tree, passed[1], counts, options.seed), encoding="utf-8")
        print(f"wrote {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()

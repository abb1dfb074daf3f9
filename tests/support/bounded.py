"""Bounds on what a test may take."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MEGABYTE = 1024 * 1024


def memory(entry: str) -> int:
    """Memory of this process that is in use, or was at its peak [bytes]."""
    found = re.search(rf"{entry}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found
    return int(found[1]) * 1024


@contextmanager
def bounded(megabytes: int = 200, seconds: int = 20) -> Iterator[None]:
    """Fail if what is inside takes longer, or more memory."""

    def too_long(*_: object) -> None:
        raise AssertionError(f"longer than {seconds} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(seconds)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    least = memory("VmRSS")
    try:
        yield
        assert memory("VmHWM") - least < megabytes * MEGABYTE
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)

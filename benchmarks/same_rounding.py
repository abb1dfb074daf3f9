"""Let every x86-64 processor with AVX2 round alike, so that results repeat to the last bit.

Libraries of linear algebra choose their code by the processor, and a fit that stops after a number
of evaluations amplifies the last bit of a sum to some per cent of a small error.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

_ENVIRONMENT = {
    # The one setting that Intel's MKL heeds on other makers' processors too.
    "MKL_CBWR": "COMPATIBLE",
    "OPENBLAS_CORETYPE": "Haswell",
    "ATEN_CPU_CAPABILITY": "avx2",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512F AVX512_SKX AVX512_ICL",
}


def round_alike() -> None:
    """Set the environment that numpy and torch read when they are loaded; workers inherit it."""
    if _has_avx2():
        os.environ.update(_ENVIRONMENT)


def _has_avx2() -> bool:
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return False
    return re.search(r"\bavx2\b", flags) is not None

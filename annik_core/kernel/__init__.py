"""The compiled kernel: forward kinematics of serial chains, and refinement on them, in C++.

``ANNIK_KERNEL=off`` in the environment leaves it out. Without it NumPy computes the same, slowly.
"""

import os
from functools import cache
from importlib import import_module
from typing import Any

#: What that means, and what to do.
NO_KERNEL = (
    "arms are solved without the compiled kernel, some thirty times slower",
    "install a C++ compiler (sudo apt install g++ python3-dev pybind11-dev), then annik again; or "
    "unset ANNIK_KERNEL",
)


@cache
def compiled_kernel() -> Any:
    """The compiled module, or None if it is switched off or was not built."""
    if os.environ.get("ANNIK_KERNEL", "").lower() == "off":
        return None
    try:
        return import_module("annik_core.kernel.compiled")
    except ImportError:
        return None

"""The compiled kernel: forward kinematics of serial chains, and refinement on them, in C++.

``ANNIK_KERNEL=off`` in the environment leaves it out. Without it NumPy computes the same, slowly.
"""

import os
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from annik_core.errors import AnnikError
from annik_core.kernel.sources import sources_hash

#: What that means, and what to do.
NO_KERNEL = (
    "arms are solved without the compiled kernel, some thirty times slower",
    "install a C++ compiler (sudo apt install g++ python3-dev pybind11-dev), then annik again; or "
    "unset ANNIK_KERNEL",
)


class StaleKernel(AnnikError):
    """The compiled kernel was built from other sources than those in its folder."""

    def __init__(self, path: Path, built_from: str, sources: str) -> None:
        self.path = path
        self.built_from = built_from
        self.sources = sources
        self.remedy = (
            "compile it again: ./run setup in a checkout, python3 -m colcon build in a workspace, "
            "otherwise pip install --force-reinstall --no-deps and what you installed; or set "
            "ANNIK_KERNEL=off"
        )
        super().__init__(
            f"the compiled kernel {path} was built from other sources than those beside it "
            f"(SHA-256 {built_from[:12]}, not {sources[:12]}): {self.remedy}"
        )


@cache
def compiled_kernel() -> Any:
    """The compiled module, or None if it is switched off or was not built.

    Raises:
        StaleKernel: if the sources in its folder are others than those it was built from. Not
            checked where no sources are, as in a wheel, nor a kernel compiled without setup.py.
    """
    if os.environ.get("ANNIK_KERNEL", "").lower() == "off":
        return None
    try:
        kernel = import_module("annik_core.kernel.compiled")
    except ImportError:
        return None
    folder = Path(__file__).parent
    built_from, sources = getattr(kernel, "sources", "unknown"), sources_hash(folder)
    if built_from and sources and built_from != sources:
        raise StaleKernel(Path(str(kernel.__file__)), built_from, sources)
    return kernel

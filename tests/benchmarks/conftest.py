"""The benchmarks need what training needs."""

from __future__ import annotations

from importlib.util import find_spec

if not find_spec("torch"):
    collect_ignore_glob = ["*"]

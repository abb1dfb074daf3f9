"""The workflow that builds the wheels builds them for what annik supports."""

import re
from importlib.metadata import metadata
from typing import Any

import pytest
import yaml
from packaging.specifiers import SpecifierSet
from support.processes import ROOT

from annik_ros.doctor import _SUPPORTED_PYTHON


@pytest.fixture(scope="module")
def job() -> Any:
    text = (ROOT / ".github" / "workflows" / "wheels.yml").read_text(encoding="utf-8")
    return yaml.safe_load(text)["jobs"]["wheels"]


@pytest.fixture(scope="module")
def options(job: Any) -> Any:
    (step,) = [step for step in job["steps"] if "cibuildwheel" in step.get("uses", "")]
    return step["env"]


def test_every_supported_python(options: Any) -> None:
    built = re.findall(r"cp3(\d+)-manylinux_\*", options["CIBW_BUILD"])
    assert len(built) == len(options["CIBW_BUILD"].split())
    (major, first), (_, last) = _SUPPORTED_PYTHON
    assert [int(minor) for minor in built] == list(range(first, last + 1))
    allowed = SpecifierSet(metadata("annik_ros")["Requires-Python"])
    assert all(f"{major}.{minor}" in allowed for minor in built)
    assert f"{major}.{first - 1}" not in allowed


def test_both_processors(job: Any) -> None:
    rows = job["strategy"]["matrix"]["include"]
    assert {row["arch"] for row in rows} == {"x86_64", "aarch64"}
    # Each on its own processor: emulated, it takes an hour.
    assert all(("arm" in row["runner"]) == (row["arch"] == "aarch64") for row in rows)


def test_each_wheel_solves_with_its_kernel(options: Any) -> None:
    script = options["CIBW_TEST_COMMAND"].removeprefix("python {project}/")
    assert "CompiledKinematics" in (ROOT / script).read_text(encoding="utf-8")

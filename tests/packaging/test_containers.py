"""The container files can be read, and what they name is there. They are built elsewhere."""

from __future__ import annotations

import json
import re
import shlex
from importlib.metadata import distribution, metadata

from support.processes import ROOT

DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
DEVCONTAINER = json.loads(
    (ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8")
)
BASE = "ros:jazzy"


def instructions() -> list[tuple[str, str]]:
    """Each instruction of the Dockerfile with its arguments, without comments."""
    lines = [line for line in DOCKERFILE.splitlines() if not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    found = [line.partition(" ") for line in joined.splitlines() if line]
    return [(name, arguments) for name, _, arguments in found]


def test_the_image_is_of_ros_jazzy_and_starts_a_node() -> None:
    parts = instructions()
    assert parts[0] == ("FROM", BASE)
    known = {"FROM", "SHELL", "RUN", "COPY", "WORKDIR", "ENV", "CMD"}
    assert {name for name, _ in parts} <= known
    (command,) = [json.loads(arguments) for name, arguments in parts if name == "CMD"]
    scripts = {e.name for e in distribution("annik_ros").entry_points}
    assert command[0] in scripts


def test_the_image_installs_what_there_is() -> None:
    text = " ".join(arguments for _, arguments in instructions())
    (extras,) = re.findall(r"annik_ros\[([\w,]+)\]", text)
    assert set(extras.split(",")) <= set(metadata("annik_ros").get_all("Provides-Extra") or ())
    assert "src/annik_ros/constraints.txt" in text
    assert (ROOT / "constraints.txt").is_file()
    for name, arguments in instructions():
        if name == "RUN":
            assert shlex.split(arguments)
    # What is copied is the checkout, without what is built in it.
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert {".git", ".venv", "build"} <= set(ignored)


def test_the_development_container_sets_up_as_everybody_does() -> None:
    assert DEVCONTAINER["image"] == BASE
    program, flag, script = DEVCONTAINER["postCreateCommand"]
    assert (program, flag) == ("bash", "-c")
    assert script.endswith("./run setup")
    assert "source /opt/ros/jazzy/setup.bash" in script


def test_the_packages_are_those_that_continuous_integration_installs() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    for package in ("python3-venv", "ros-jazzy-ros2launch"):
        assert package in workflow
        assert package in DOCKERFILE
        assert package in DEVCONTAINER["onCreateCommand"]

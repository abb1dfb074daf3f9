"""Write the generated parts of the documentation, and the parameter files of the nodes.

A generated part of a page is between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``; the files
``config/NODE.yaml`` are generated as a whole. With ``--check`` nothing is written; the exit code
is 1 if anything that comes from the code is out of date. With ``--demo FOLDER`` the measured
results and the pictures of a demo are included, with ``--learn FOLDER`` those of ``./run learn``,
with ``--learn-sockets FOLDER`` those of ``./run learn --sockets``.
"""

from __future__ import annotations

import argparse
import inspect
import json
import math
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from annik_core.safety import AcceptanceLimits
from annik_ros.parameters import Parameter
from annik_training.designs.registry import DESIGNS
from annik_training.designs.thirty_phase_design import phases as phases_of
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table
from docs.diagnostic_values import DIAGNOSTIC_VALUES, LEVELS
from docs.parameter_tables import PARAMETER_TABLES
from docs.refusals import REFUSALS
from docs.services import SERVICES
from msg_tools.topics import TOPICS

DOCS = Path(__file__).parent
CONFIG = DOCS.parent / "config"
README = DOCS.parent / "README.md"
LEARN = DOCS / "learn_your_robot.md"
PICTURES = {"errors.png": "tracking_error.png", "path.png": "path.png"}
LEARN_PICTURES = {"before_and_after.png": "before_and_after.png"}
LEARN_SOCKETS_PICTURES = {"before_and_after.png": "before_and_after_sockets.png"}


def api() -> str:
    """The public names of the packages, with their parameters and their first sentence."""
    parts = []
    for package in ("annik_core", "annik_training", "msg_tools"):
        module = import_module(package)
        rows = []
        for name in module.__all__:
            value = getattr(module, name)
            parameters = _parameters(value) if inspect.isfunction(value) else ""
            sentence = str(inspect.getdoc(value)).partition("\n\n")[0]
            rows.append((f"`{name}{parameters}`", _as_markdown(sentence)))
        parts.append(f"## {package}\n\n{markdown_table(('name', 'what it is'), rows)}")
    return "\n\n".join(parts)


def _parameters(function: Callable[..., object]) -> str:
    """The parameters of a function without their types."""
    signature = inspect.signature(function)
    untyped = [
        parameter.replace(annotation=inspect.Parameter.empty)
        for parameter in signature.parameters.values()
    ]
    return str(signature.replace(parameters=untyped, return_annotation=inspect.Signature.empty))


def _as_markdown(sentence: str) -> str:
    """A sentence of a docstring in Markdown, on one line."""
    return re.sub(r":\w+:`~?([^`]*)`", r"`\1`", " ".join(sentence.split())).replace("``", "`")


def topics() -> str:
    """All topics."""
    rows = [(f"`{t.name}`", f"`{t.type}`", t.publisher, t.subscriber, t.meaning) for t in TOPICS]
    return markdown_table(("topic", "type", "published by", "received by", "meaning"), rows)


def parameters(node: str) -> Callable[[], str]:
    """The parameters of one node."""

    def parameter_rows() -> str:
        rows = [
            (f"`{row.name}`", _default(node, row), row.allowed, _when(row), row.description)
            for row in PARAMETER_TABLES[node]
        ]
        return markdown_table(("parameter", "default", "allowed", "set", "meaning"), rows)

    return parameter_rows


def services() -> str:
    """The services of ik_node."""
    rows = [(f"`{s.name}`", f"`{s.type}`", s.meaning) for s in SERVICES]
    return markdown_table(("service", "type", "what it does"), rows)


def refusals() -> str:
    """Why a target may be refused, in the order of the checks."""
    rows = [(f"`{status.value}`", meaning) for status, meaning in REFUSALS.items()]
    return markdown_table(("`refused: ...` in /diagnostics", "when"), rows)


def diagnostics(node: str) -> Callable[[], str]:
    """What one node reports."""

    def values() -> str:
        rows = [(f"`{key}`", meaning) for key, meaning in DIAGNOSTIC_VALUES[node].items()]
        return markdown_table(("value", "meaning"), rows)

    return values


def levels() -> str:
    """When a report is a warning or an error."""
    return markdown_table(
        ("level", "when"), [(f"{level}", when) for level, when in LEVELS.items()]
    )


def designs() -> str:
    """The designs of experiments."""
    rows = [
        (f"`{d.name}`", f"`{d.size.flag}`: {d.size.meaning}", f"{d.size.default}", d.description)
        for d in DESIGNS.values()
    ]
    return markdown_table(("design", "size", "default", "what it is"), rows)


def describe_phases(dof: int) -> Iterator[str]:
    """One line per phase, joints counted from 1, for the documentation."""
    names = ("min", "med", "max")
    for number, phase in enumerate(phases_of(dof), start=1):
        swept = ", ".join(f"q{joint + 1}" for joint in phase.swept)
        others = "" if len(phase.swept) == dof else f", the others at {names[phase.held_at]}"
        yield f"{number}: {swept} swept{others}"


def phases() -> str:
    """The paper's phases for six joints."""
    return "\n".join(f"    {line}" for line in describe_phases(6))


def result(name: str) -> Callable[[], str]:
    """What a benchmark has written to docs/results, without its first line, which says so."""

    def measured() -> str:
        text = (DOCS / "results" / f"{name}.md").read_text(encoding="utf-8")
        return text.partition("\n")[2].strip()

    return measured


def computed_examples() -> str:
    """How many computed examples a whole robot needs: figure and table."""
    what = "answered poses, recall and starts against the number of computed examples"
    figure = f"![{what}](images/study_computed_examples.png)"
    return f"{figure}\n\n{result('computed_examples')()}"


def kernel_size() -> str:
    """The lines of C++ in the kernel, to fifty, so that not every change of it is one here."""
    lines = sum(
        len(path.read_text(encoding="utf-8").splitlines())
        for path in (DOCS.parent / "annik_core" / "kernel").glob("*.?pp")
    )
    return f"about {50 * round(lines / 50):,} lines of C++17."


def limits() -> str:
    """The default acceptance limits, in the units of a reader."""
    defaults = AcceptanceLimits()
    return (
        f"{1e3 * defaults.max_position_residual:g} mm and "
        f"{math.degrees(defaults.max_orientation_residual):.2g} degrees"
    )


def demo(results: Mapping[str, object]) -> str:
    """What the demo measured."""
    position, orientation, latency, training = (
        _mapping(results[key])
        for key in ("position_error_mm", "orientation_error_deg", "latency_us", "training")
    )
    rows = [
        ("examples", f"{training['examples']}"),
        ("training", f"{training['seconds']:.1f} s"),
        (
            "targets sent / answered / refused",
            f"{results['targets_sent']} / {results['targets_answered']} / "
            f"{results['targets_refused']}",
        ),
        ("position error", f"{position['p50']:.5f} mm median, {position['max']:.5f} mm worst"),
        (
            "orientation error",
            f"{orientation['p50']:.6f} degrees median, {orientation['max']:.6f} degrees worst",
        ),
        ("target to command", f"{latency['p50']:.0f} us median, {latency['p99']:.0f} us p99"),
    ]
    measured = markdown_table(("measured by `./run demo`", ""), rows)
    return f"{measured}\n\n{machine()}"


def learn(results: Mapping[str, object]) -> str:
    """What ``./run learn`` measured."""
    fit = _mapping(results["fit"])
    rows = [
        ("measured poses", f"{fit['examples']}"),
        ("calibration, without the training of the network", f"{fit['seconds']:.1f} s"),
    ]
    for model, name in (("nominal", "nominal"), ("calibrated", "learned")):
        driven: Any = results[name]
        rows += [
            (
                f"{model} model: targets sent / solved",
                f"{driven['targets_sent']} / {driven['targets_answered']}",
            ),
            (
                f"{model} model: position error",
                f"{driven['position_error_mm']['p50']:.4f} mm median, "
                f"{driven['position_error_mm']['max']:.4f} mm worst",
            ),
            (
                f"{model} model: orientation error",
                f"{driven['orientation_error_deg']['p50']:.5f} degrees median, "
                f"{driven['orientation_error_deg']['max']:.5f} degrees worst",
            ),
        ]
    return f"{markdown_table(('measured by `./run learn`', ''), rows)}\n\n{machine()}"


def learn_sockets(results: Mapping[str, object]) -> str:
    """What ``./run learn --sockets`` measured."""
    fit = _mapping(results["fit"])
    rows = [
        ("rows, with the ball in a socket", f"{fit['examples']}"),
        ("calibration, without the training of the network", f"{fit['seconds']:.1f} s"),
    ]
    for model, name in (("nominal", "nominal"), ("calibrated", "learned")):
        driven: Any = results[name]
        rows += [
            (
                f"{model} model: {what}",
                f"{driven[key]['mean']:.4f} mm, {driven[key]['max']:.4f} mm",
            )
            for what, key in (
                ("balls in a socket from their mean, mean and largest", "sockets_mm"),
                ("ball from its path, mean and largest", "path_mm"),
            )
        ]
        rows.append(
            (
                f"{model} model: error of the distance of the sockets",
                f"{driven['distance_error_mm']:.4f} mm",
            )
        )
    return f"{markdown_table(('measured by `./run learn --sockets`', ''), rows)}\n\n{machine()}"


def _mapping(value: object) -> Mapping[str, float]:
    assert isinstance(value, Mapping)
    return value


def _default(node: str, row: Parameter) -> str:
    if isinstance(row.default, tuple) and len(row.default) > 3:
        return f"see `config/{node}.yaml`"
    return f"`{_in_yaml(row.default)}`"


def _in_yaml(value: object) -> str:
    """A value in one line of YAML."""
    if value == "":
        return '""'
    if isinstance(value, tuple):
        value = list(value)
    return yaml.safe_dump(value, default_flow_style=True, width=math.inf).splitlines()[0]


def parameter_file(node: str) -> str:
    """The parameter file of a node, with every default."""
    lines = [
        "# Written by ./run docs from the node's parameters.",
        "# /** is any node in any namespace, so that the file works under any name.",
        "/**:",
        "  ros__parameters:",
    ]
    for row in PARAMETER_TABLES[node]:
        lines += [f"    # {line}" for line in textwrap.wrap(row.description, 93)]
        if isinstance(row.default, tuple) and len(row.default) > 3:
            lines += [f"    {row.name}:", *(f"      - {_in_yaml(item)}" for item in row.default)]
        else:
            unit = f" # [{row.setting.unit}]" if row.setting.unit else ""
            lines.append(f"    {row.name}: {_in_yaml(row.default)}{unit}")
    return "\n".join(lines) + "\n"


def _when(row: Parameter) -> str:
    return "at start" if row.read_only else "any time"


PARTS: Mapping[Path, Mapping[str, Callable[[], str]]] = {
    README: {"topics": topics, "calibrate": result("calibrate_short")},
    DOCS / "api.md": {"api": api},
    DOCS / "ros_interface.md": {
        "topics": topics,
        "services": services,
        "refusals": refusals,
        "diagnostic levels": levels,
        **{f"{node} diagnostics": diagnostics(node) for node in DIAGNOSTIC_VALUES},
        "limits": limits,
        **{f"{node} parameters": parameters(node) for node in PARAMETER_TABLES},
    },
    DOCS / "architecture.md": {"kernel size": kernel_size, "sanitizers": result("sanitizers")},
    DOCS / "training.md": {"designs": designs, "phases": phases},
    DOCS / "arms.md": {
        "arms": result("arms"),
        "ik_bench": result("ik_bench"),
        "ik_whole_robot": result("ik_whole_robot"),
    },
    DOCS / "installation.md": {"install": result("install")},
    DOCS / "study.md": {"computed_examples": computed_examples},
    LEARN: {"calibrate": result("calibrate"), "learn_robot": result("learn_robot")},
    DOCS / "whole_robot.md": {"robots": result("robots")},
    DOCS / "performance.md": {"node_bench": result("node_bench")},
    DOCS / "see_your_robot.md": {
        "long_bag": result("long_bag"),
        "view_page": result("view_page"),
    },
}


def with_part(text: str, name: str, content: str) -> str:
    """The text with one generated part replaced."""
    pattern = re.compile(
        rf"(<!-- begin {re.escape(name)} -->\n).*?(<!-- end {re.escape(name)} -->)", re.DOTALL
    )
    if not pattern.search(text):
        sys.exit(f"no part {name!r} to fill")
    return pattern.sub(lambda match: f"{match[1]}{content}\n{match[2]}", text)


def main() -> None:
    """Update or check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--demo", type=Path)
    parser.add_argument("--learn", type=Path)
    parser.add_argument("--learn-sockets", type=Path)
    arguments = parser.parse_args()
    stale = []

    def update(path: Path, text: str, updated: str) -> None:
        if updated != text:
            stale.append(str(path.relative_to(DOCS.parent)))
            if not arguments.check:
                path.write_text(updated, encoding="utf-8")

    for node in PARAMETER_TABLES:
        path = CONFIG / f"{node}.yaml"
        update(path, path.read_text(encoding="utf-8"), parameter_file(node))
    for path, parts in PARTS.items():
        text = path.read_text(encoding="utf-8")
        updated = text
        for name, content in parts.items():
            updated = with_part(updated, name, content())
        for page, folder, name, content_of in (
            (README, arguments.demo, "demo", demo),
            (LEARN, arguments.learn, "learn", learn),
            (LEARN, arguments.learn_sockets, "learn sockets", learn_sockets),
        ):
            if path == page and folder:
                results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
                updated = with_part(updated, name, content_of(results))
        update(path, text, updated)
    for folder, pictures in (
        (arguments.demo, PICTURES),
        (arguments.learn, LEARN_PICTURES),
        (arguments.learn_sockets, LEARN_SOCKETS_PICTURES),
    ):
        if folder and not arguments.check:
            for source, name in pictures.items():
                shutil.copyfile(folder / source, DOCS / "images" / name)
    if arguments.check and stale:
        sys.exit(f"out of date, run ./run docs: {', '.join(stale)}")


if __name__ == "__main__":
    main()

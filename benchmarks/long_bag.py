"""The report of long bags: time, memory, and whether its page opens in a browser.

The bags are generated: a robot that follows a circle at 100 targets a second, 0.1 mm off, and
whose ik_node refuses every thousandth target.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from shutil import rmtree
from typing import Any, NamedTuple

import click
import numpy as np

from annik_core.pose import FloatArray, tracking_error
from benchmarks.command_line import (
    docs_folder,
    docs_option,
    numbers,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table
from docs.browser import browser, chromium
from msg_tools import topics
from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.writer import BagWriter

#: Messages of the bags, the longest last.
_MESSAGES, _QUICK_MESSAGES = (100_000, 1_000_000), (5_000, 20_000)
_REFUSED_EVERY = 1000
_START_NS, _PERIOD_NS = 1_700_000_000_000_000_000, 10_000_000
#: From a target to its command, and to its result [ns].
_LATENCY_NS, _RESULT_NS = 500_000, 600_000
_MB = 1e6


class Measured(NamedTuple):
    """What the report of one bag took."""

    messages: int
    bag_bytes: int
    seconds: float
    peak_bytes: int  #: memory of the whole process, at most
    page_bytes: int
    opened: float | None  #: until the plots are drawn [s]; None without a browser


@click.command()
@click.option("--messages", callback=numbers, help="Messages of each bag: a list like 1000,2000.")
@quick_option("Short bags")
@out_option("long_bag", "the bags, their reports and the table")
@docs_option("the table, in results/ there,")
def long_bag(messages: tuple[int, ...] | None, quick: bool, out: Path, docs: Path | None) -> None:
    """Report long bags: time, memory, and whether the page opens."""
    chosen = messages or (_QUICK_MESSAGES if quick else _MESSAGES)
    docs = docs_folder(docs, standard=chosen == _MESSAGES, quick=quick)
    folders = output_folders(out, docs)
    measured = []
    for count in chosen:
        bag = out / f"bag_{count}"
        rmtree(bag, ignore_errors=True)
        click.echo(f"writing {bag}")
        write_bag(bag, count)
        measured.append(measure(bag, out / f"report_{count}"))
    rows = [
        (
            f"{row.messages:,}",
            f"{row.bag_bytes / _MB:.0f}",
            f"{row.seconds:.0f}",
            f"{row.peak_bytes / _MB:.0f}",
            f"{row.page_bytes / _MB:.1f}",
            "" if row.opened is None else f"{row.opened:.0f}",
        )
        for row in measured
    ]
    header = ("messages", "bag [MB]", "report [s]", "peak memory [MB]", "page [MB]", "opened [s]")
    lines = [
        "<!-- Written by ./run bench long_bag -->",
        "",
        markdown_table(header, rows, numbers=len(header)),
        "",
        machine(),
    ]
    write_table("long_bag", lines, folders)


def write_bag(folder: Path, messages: int) -> int:
    """Write a bag of at least so many messages; returns how many."""
    types = jazzy_types()
    names = {
        topic: f"/{topic.name.lstrip('/')}"
        for topic in (
            topics.TARGET_POSE,
            topics.JOINT_COMMAND,
            topics.ACCEPTED_TARGET,
            topics.JOINT_STATES,
            topics.ACHIEVED_POSE,
            topics.POSITION_ERROR,
            topics.ORIENTATION_ERROR,
            topics.DIAGNOSTICS,
        )
    }
    refused = 0
    with BagWriter(folder) as bag:
        for topic, name in names.items():
            bag.add_topic(name, topic.type)

        def add(topic: topics.Topic, sent: int, content: Any) -> None:
            cdr = bytes(types.serialize_cdr(content, topic.type))
            bag.write(names[topic], cdr, sent + 50_000, sent)

        number = 0
        while bag.message_count < messages:
            sent = _START_NS + number * _PERIOD_NS
            stamp = sent + 100_000
            target = _target(number)
            add(topics.TARGET_POSE, sent, _pose(target))
            if number % _REFUSED_EVERY == _REFUSED_EVERY - 1:
                refused += 1
            else:
                achieved = target + np.array([1e-4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
                error = tracking_error(target, achieved)
                done, moved = sent + _LATENCY_NS, sent + _RESULT_NS
                add(topics.JOINT_COMMAND, done, _joint_state(stamp))
                add(topics.ACCEPTED_TARGET, done, _stamped_pose(stamp, target))
                add(topics.JOINT_STATES, moved, _joint_state(stamp))
                add(topics.ACHIEVED_POSE, moved, _stamped_pose(stamp, achieved))
                add(topics.POSITION_ERROR, moved, _stamped_vector(stamp, error.position))
                add(topics.ORIENTATION_ERROR, moved, _stamped_vector(stamp, error.orientation))
            if number % 100 == 99:
                add(topics.DIAGNOSTICS, sent, _diagnostics(stamp, number + 1, refused))
            number += 1
        return bag.message_count


def measure(bag: Path, folder: Path) -> Measured:
    """Report a bag in a process of its own, and open the page."""
    page = folder / "interactive.html"
    command = ("-m", "annik_training.cli", "report", bag, "--out", folder, "--html", page)
    started = time.perf_counter()
    process = subprocess.Popen([sys.executable, *map(str, command)], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - started
    if status:
        raise click.ClickException(f"the report of {bag} failed")
    (file,) = bag.glob("*.mcap")
    return Measured(
        messages=int(bag.name.rpartition("_")[2]),
        bag_bytes=file.stat().st_size,
        seconds=seconds,
        peak_bytes=1024 * usage.ru_maxrss,
        page_bytes=page.stat().st_size,
        opened=_opened(page),
    )


def _opened(page: Path) -> float | None:
    executable = chromium()
    if executable is None:
        return None
    with browser(executable) as tab:
        started = time.perf_counter()
        tab.goto(page.resolve().as_uri())
        tab.wait_for_function("document.querySelectorAll('.main-svg').length > 4")
        tab.screenshot(path=page.with_suffix(".png"))
        return time.perf_counter() - started


def _target(number: int) -> FloatArray:
    angle = 2.0 * np.pi * number / 1000.0
    position = [0.4 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.5]
    return np.array([*position, 0.0, np.sin(0.1 * angle), 0.0, np.cos(0.1 * angle)])


def _make(kind: str, *fields: Any) -> Any:
    return jazzy_types().types[kind](*fields)


def _header(stamp: int) -> Any:
    time_of = _make("builtin_interfaces/msg/Time", *divmod(stamp, 1_000_000_000))
    return _make("std_msgs/msg/Header", time_of, "base_link")


def _pose(pose: FloatArray) -> Any:
    values = pose.tolist()
    position = _make("geometry_msgs/msg/Point", *values[:3])
    return _make(
        "geometry_msgs/msg/Pose", position, _make("geometry_msgs/msg/Quaternion", *values[3:])
    )


def _stamped_pose(stamp: int, pose: FloatArray) -> Any:
    return _make("geometry_msgs/msg/PoseStamped", _header(stamp), _pose(pose))


def _stamped_vector(stamp: int, vector: FloatArray) -> Any:
    content = _make("geometry_msgs/msg/Vector3", *vector.tolist())
    return _make("geometry_msgs/msg/Vector3Stamped", _header(stamp), content)


def _joint_state(stamp: int) -> Any:
    names, none = [f"joint_{joint}" for joint in range(6)], np.zeros(0)
    return _make("sensor_msgs/msg/JointState", _header(stamp), names, np.full(6, 0.1), none, none)


def _diagnostics(stamp: int, received: int, refused: int) -> Any:
    values = {
        "targets received": received,
        "targets refused": refused,
        **({"refused: outside workspace": refused} if refused else {}),
    }
    entries = [
        _make("diagnostic_msgs/msg/KeyValue", key, str(value)) for key, value in values.items()
    ]
    kind = "diagnostic_msgs/msg/DiagnosticStatus"
    status = _make(kind, 0, "/ik_node: targets", "", "", entries)
    return _make("diagnostic_msgs/msg/DiagnosticArray", _header(stamp), [status])

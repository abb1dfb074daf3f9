"""Nowhere to write: not the bag, not the log."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from invariants import (
    UNREACHABLE,
    assert_every_command_belongs_to_a_target,
    connect,
    good_target,
    wait_for_counts,
)
from rosbags.rosbag2 import Reader
from support.processes import Process

from msg_tools.bags.reader import read_bag

# A file system of 100 KiB of its own, in which the recorder runs, and what is left of the bag.
ON_A_SMALL_DISK = """
mount -t tmpfs -o size=100k none {disk} || exit 99
{python} -m annik_ros.bag_recorder.node --ros-args -p output:={disk}/bag -p topics:=[joint_command]
code=$?
cp -r {disk}/bag {copy}
exit $code
"""


def _unshare(script: str) -> list[str]:
    return ["unshare", "--user", "--map-root-user", "--mount", "bash", "-c", script]


@pytest.fixture
def small_disk(tmp_path: Path) -> Path:
    """A folder on which a process can mount a disk that nobody else sees."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = f"mount -t tmpfs -o size=100k none {disk}"
    try:
        code = subprocess.run(_unshare(mount), capture_output=True, check=False).returncode
    except FileNotFoundError:
        code = 1
    if code != 0:
        pytest.skip("this machine lets nobody mount a disk of his own")
    return disk


@pytest.fixture
def recorder(small_disk: Path, domain: int, tmp_path: Path) -> Iterator[Process]:
    """A recorder on that disk; the bag is in ``copy`` when it has ended."""
    script = ON_A_SMALL_DISK.format(disk=small_disk, python=sys.executable, copy=tmp_path / "copy")
    environment = {"ROS_DOMAIN_ID": str(domain)}
    process = Process(*_unshare(script), log=tmp_path / "recorder.log", environment=environment)
    yield process
    process.kill()


def test_a_disk_that_fills_up_ends_the_recording_and_nothing_else(
    launch: Callable[..., Any],
    client: Any,
    recorder: Process,
    tmp_path: Path,
) -> None:
    """The recorder says so and ends with code 1; its bag has all until then; targets go on."""
    launch("ik_node", "-p", "queue_depth:=1000")
    connect(client)
    # The client listens too, and so does the recorder.
    client.wait_until(lambda: client.command.get_subscription_count() == 2, "the recorder")
    number = 0

    def ended() -> bool:
        nonlocal number
        for _ in range(20):
            number += 1
            client.send(good_target(number))
        client.wait_for_results(good_target(number), ["joint_command"])
        return not recorder.is_running

    client.wait_until(ended, "the end of the recording")
    assert recorder.wait_for_exit() == 1, recorder.log
    assert "No space left on device" in recorder.log
    assert "Traceback" not in recorder.log
    recorded = [
        record.message.header.stamp
        for record in read_bag(tmp_path / "copy").records({"/joint_command"})
    ]
    stamps = [stamp.sec * 10**9 + stamp.nanosec for stamp in recorded]
    assert len(stamps) > 100
    published = client.stamps("joint_command")
    # The recorder may have heard some before, when the client was not yet counting.
    shared = [stamp for stamp in stamps if stamp >= published[0]]
    first = published.index(shared[0])
    assert shared == published[first : first + len(shared)]
    # The count in its metadata is older: there was no room to write that anew.
    with Reader(tmp_path / "copy") as reader:
        assert len(list(reader.messages())) == len(stamps)
    assert_every_command_belongs_to_a_target(
        client, [good_target(index) for index in range(number + 1)]
    )


def test_a_log_that_can_not_be_written_stops_nobody(
    launch: Callable[..., Any], client: Any
) -> None:
    """On a full disk, every line of the log is lost, and no target."""
    full = Path("/dev/full")
    ik_node = launch("ik_node", "-p", "queue_depth:=1000", ready=False, log=full)
    robot = launch("fake_robot", ready=False, log=full)
    contacts = connect(client, "tracking_error/orientation")
    for _ in range(3):
        client.send(UNREACHABLE)
    assert wait_for_counts(client, contacts + 3).refused == 3
    client.send(good_target(1))
    client.wait_for_results(good_target(1), ["joint_command", "tracking_error/orientation"])
    for node in (ik_node, robot):
        node.signal(signal.SIGINT)
        assert node.wait_for_exit() == 0

"""Processes that are stopped, killed and started again in the middle of a path."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable
from typing import Any

from invariants import (
    UNREACHABLE,
    assert_all_numbers_finite,
    assert_every_command_belongs_to_a_target,
    connect,
    counts_in,
    good_target,
    wait_for_counts,
)

from annik_core.pose import FloatArray

ERROR = "tracking_error/orientation"


def _follow(client: Any, numbers: Iterable[int]) -> list[FloatArray]:
    """Send a part of a path, with a bad target after each good one."""
    targets = [good_target(number) for number in numbers]
    for target in targets:
        client.send(target)
        client.send(UNREACHABLE)
        client.take_messages(0.005)
    return targets


def test_a_stopped_node_goes_on_where_it_was(launch: Callable[..., Any], client: Any) -> None:
    """Either of the two nodes: what waited is answered in order, and every count is right."""
    deep = "-p", "queue_depth:=1000"
    nodes = [
        launch("ik_node", *deep, ready=False),
        launch("fake_robot"),
    ]
    received = connect(client, ERROR)
    contacts = received
    targets: list[FloatArray] = []
    for turn, node in enumerate(nodes):
        node.signal(signal.SIGSTOP)
        targets += _follow(client, range(1 + 40 * turn, 41 + 40 * turn))
        received += 80
        node.signal(signal.SIGCONT)
        client.wait_for_results(targets[-1], ["joint_command", ERROR])
    counts = wait_for_counts(client, received)
    assert counts.refused == 80
    assert_every_command_belongs_to_a_target(client, targets)
    accepted = [message.pose.position.x for message in client.received["accepted_target"]]
    assert accepted == [float(target[0]) for target in targets]
    _, values = client.wait_for_status(
        "fake_robot",
        lambda values: int(values["commands received"]) >= counts.accepted - contacts,
        "all commands",
    )
    assert counts_in(values, "commands").refused == 0


def test_what_is_killed_is_replaced_by_another(launch: Callable[..., Any], client: Any) -> None:
    """Either of the two nodes, in the middle of a path: the next target is answered."""
    deep = "-p", "queue_depth:=1000"
    ik_node = launch("ik_node", *deep, ready=False)
    robot = launch("fake_robot")
    received = connect(client, ERROR)
    targets = _follow(client, range(1, 30))
    robot.signal(signal.SIGKILL)
    targets += _follow(client, range(30, 60))
    # Without a robot, targets are answered as with one.
    client.wait_for_results(targets[-1], ["joint_command"])
    assert robot.wait_for_exit() == -signal.SIGKILL
    counts = wait_for_counts(client, received + 2 * 59)
    assert counts.refused == 59
    robot = launch("fake_robot")
    targets.append(good_target(100))
    client.connect(good_target(100), ERROR)

    targets += _follow(client, range(101, 130))
    ik_node.signal(signal.SIGKILL)
    targets += _follow(client, range(130, 140))
    assert ik_node.wait_for_exit() == -signal.SIGKILL
    # Of its last answer, the one half may have gone out and the other not.
    client.take_the_rest()
    assert_all_numbers_finite(client)
    for messages in client.received.values():
        messages.clear()
    ik_node = launch("ik_node", *deep)
    # It begins to count anew.
    received = connect(client, ERROR, first=100)
    targets += _follow(client, range(201, 230))
    client.wait_for_results(targets[-1], ["joint_command", ERROR])
    assert_every_command_belongs_to_a_target(client, targets)
    counts = wait_for_counts(client, received + 2 * 29)
    assert (counts.accepted, counts.refused) == (received + 29, 29)
    assert robot.is_running
    assert "Traceback" not in robot.log + ik_node.log

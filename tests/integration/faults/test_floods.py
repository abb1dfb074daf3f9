"""Too much at once, and much after a long silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from invariants import (
    UNREACHABLE,
    assert_every_command_belongs_to_a_target,
    connect,
    counts_in,
    good_target,
)
from support.client import Client

from msg_tools.conversions.pose import pose_from_array

#: A node that keeps what it should drop grows by more than this in a flood [bytes].
LARGEST_GROWTH = 30e6


def resident_memory(process: int) -> int:
    """Memory of a process [bytes]."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return 4096 * pages


@pytest.mark.parametrize("executor", ["events", "single_threaded"])
def test_a_flood_of_good_and_bad_targets_is_survived_and_the_newest_answered(
    launch: Callable[..., Any], client: Any, executor: str
) -> None:
    """As fast as they can be sent, at depth 1: in order, each once, no growth, counts exact."""
    node = launch("ik_node", "-p", f"executor:={executor}")
    received = connect(client)
    before = resident_memory(node.pid)
    bad = pose_from_array(UNREACHABLE)
    # No more than the client keeps, which takes none while it sends: a quick node answers most.
    good = [good_target(number) for number in range(1, 901)]
    messages = [pose_from_array(target) for target in good]
    for message in messages:
        client.target.publish(bad)
        client.target.publish(message)
    client.wait_until(lambda: client.stamps_of(good[-1]), "the newest target's answer")
    assert_every_command_belongs_to_a_target(client, [good_target(0), *good])
    accepted = [message.pose.position.x for message in client.received["accepted_target"]]
    assert accepted == sorted(set(accepted))
    _, values = client.wait_for_status("ik_node", lambda _: True, "any state")
    assert counts_in(values).accepted - received == len(accepted)
    assert resident_memory(node.pid) - before < LARGEST_GROWTH


def test_a_burst_after_a_silence_is_answered_whole(
    launch: Callable[..., Any], make_client: Callable[..., Client]
) -> None:
    """The silence is an error if targets are expected; two publishers at once are told apart."""
    launch("ik_node", "-p", "queue_depth:=2000", "-p", "expected_rate:=10.0")
    clients = make_client(), make_client()
    for number, client in enumerate(clients):
        connect(client, first=100 * number)
    one, other = clients

    def silent() -> bool:
        found = one.status("ik_node")
        return found is not None and found[0].level == bytes([DiagnosticStatus.ERROR[0]])

    one.received["/diagnostics"].clear()
    one.wait_until(silent, "an error: nothing came, and something was expected")
    for client in clients:
        client.received["accepted_target"].clear()
        client.received["joint_command"].clear()
    first = [good_target(number) for number in range(1000, 1400)]
    second = [good_target(number) for number in range(2000, 2400)]
    for mine, others in zip(first, second, strict=True):
        one.target.publish(pose_from_array(mine))
        other.target.publish(pose_from_array(others))
    for targets in (first, second):
        one.wait_until(lambda targets=targets: one.stamps_of(targets[-1]), "the last of the burst")
    one.wait_until(lambda: len(one.received["accepted_target"]) >= 800, "all of the burst")
    accepted = [message.pose.position.x for message in one.received["accepted_target"]]
    for targets in (first, second):
        expected = [float(target[0]) for target in targets]
        assert [x for x in accepted if x in set(expected)] == expected
    assert_every_command_belongs_to_a_target(one, [*first, *second])
    _, values = one.wait_for_status("ik_node", lambda _: True, "any state")
    assert counts_in(values).refused == 0

"""Every transition of the life cycle, the possible and the impossible, over its services."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from invariants import (
    assert_every_command_belongs_to_a_target,
    connect,
    counts_in,
    good_target,
    wait_for_counts,
)
from lifecycle_msgs.msg import Transition
from support.processes import EXIT_PATIENCE

IMPOSSIBLE = {
    "unconfigured": ("activate", "deactivate", "cleanup"),
    "inactive": ("configure", "deactivate"),
    "active": ("activate", "configure", "cleanup"),
    "finalized": ("configure", "activate", "deactivate", "cleanup"),
}


def _refuses_the_impossible(client: Any, state: str) -> None:
    """Each transition that a state does not have is refused, and the state stays."""
    assert client.state("ik_node") == state
    numbers = [getattr(Transition, f"TRANSITION_{label.upper()}") for label in IMPOSSIBLE[state]]
    for wrong in (*IMPOSSIBLE[state], *numbers, 99, 255, "dance"):
        assert not client.change_state("ik_node", wrong), wrong
    assert client.state("ik_node") == state


@pytest.mark.parametrize("executor", ["events", "single_threaded"])
def test_an_ik_node_commands_only_while_it_is_active(
    launch: Callable[..., Any], client: Any, other_robots_model: Path, executor: str
) -> None:
    """Through a whole life, with another robot's model in the second half of it."""
    node = launch(
        "ik_node",
        *("-p", "autostart:=false", "-p", "queue_depth:=100", "-p", f"executor:={executor}"),
        ready=False,
        own_interpreter=True,
    )
    _refuses_the_impossible(client, "unconfigured")
    response = client.call("ik_node/reload_model")
    assert not response.success
    assert "unconfigured" in response.message

    assert client.change_state("ik_node", Transition.TRANSITION_CONFIGURE)
    _refuses_the_impossible(client, "inactive")
    for number in range(3):
        client.send(good_target(number))
    client.send_stamped(good_target(3), "base_link")
    assert wait_for_counts(client, 4).reasons == {"not active": 4}
    assert not client.received["joint_command"]

    assert client.change_state("ik_node", "activate")
    _refuses_the_impossible(client, "active")
    client.send(good_target(4))
    client.wait_for_results(good_target(4), ["joint_command"])

    assert client.change_state("ik_node", "deactivate")
    client.send(good_target(5))
    assert wait_for_counts(client, 6).reasons == {"not active": 5}
    assert client.change_state("ik_node", "activate")
    client.send(good_target(6))
    client.wait_for_results(good_target(6), ["joint_command"])
    assert_every_command_belongs_to_a_target(client, [good_target(4), good_target(6)])

    assert client.change_state("ik_node", "deactivate")
    assert client.change_state("ik_node", "cleanup")
    assert client.set_parameter("ik_node", "model", str(other_robots_model)).successful
    assert client.change_state("ik_node", "configure")
    assert client.change_state("ik_node", "activate")
    client.connect(good_target(7))
    assert client.received["joint_command"][-1].name[0] == "other_x_drive_joint"
    _, values = client.wait_for_status("ik_node", lambda v: v.get("robot") == "other", "the robot")
    counts_in(values)

    assert client.change_state("ik_node", Transition.TRANSITION_ACTIVE_SHUTDOWN)
    _refuses_the_impossible(client, "finalized")
    node.signal(signal.SIGINT)
    assert node.wait_for_exit(EXIT_PATIENCE) == 0
    assert "Traceback" not in node.log


def test_a_configuration_that_fails_may_be_tried_again(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """With a parameter that was wrong put right; meanwhile the node waits, and says why."""
    missing = tmp_path / "missing.onnx"
    node = launch("ik_node", "-p", "autostart:=false", "-p", f"model:={missing}", ready=False)
    for _ in range(2):
        assert not client.change_state("ik_node", "configure")
        assert client.state("ik_node") == "unconfigured"
    assert f"not configured: model {missing}" in node.log
    assert client.set_parameter("ik_node", "model", "").successful
    assert client.change_state("ik_node", "configure")
    assert client.change_state("ik_node", "activate")
    connect(client)
    assert client.change_state("ik_node", "shutdown")
    assert client.state("ik_node") == "finalized"
    node.wait_for_text("finalized")


def test_transitions_in_the_middle_of_a_stream_lose_no_count(
    launch: Callable[..., Any], client: Any
) -> None:
    """Every target is answered or refused as not active; none in between, and none twice."""
    launch("ik_node", "-p", "queue_depth:=10000")
    sent = connect(client)
    contacts = sent
    targets = []
    for turn in range(4):
        for number in range(50):
            targets.append(good_target(1 + 50 * turn + number))
            client.send(targets[-1])
        sent += 50
        assert client.change_state("ik_node", "activate" if turn % 2 else "deactivate")
    counts = wait_for_counts(client, sent)
    assert set(counts.reasons) <= {"not active"}
    client.wait_until(
        lambda: len(client.received["accepted_target"]) == counts.accepted - contacts,
        "all answers",
    )
    assert_every_command_belongs_to_a_target(client, [good_target(0), *targets])

"""target_publisher: paths for the served robot, and an exit code that says what came of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

# Of targets that wait, a late ik_node takes the newest only, unless it is told otherwise.
QUEUE = ("-p", "queue_depth:=1000")
ACHIEVED = ("-p", "rate:=100.0", "-p", "expected_results:=achieved")


@pytest.mark.parametrize("path", ["diagonal", "line", "circle"])
@pytest.mark.parametrize("model", ["gantry", "ur5e"])
def test_the_served_robot_follows_every_path(
    launch: Callable[..., Any], model: str, path: str
) -> None:
    """Exit code 0: each target was accepted by ik_node, and followed by the robot."""
    for node, options in (("ik_node", QUEUE), ("fake_robot", ())):
        launch(node, "-p", f"model:={model}", *options)
    publisher = launch(
        "target_publisher",
        *("-p", f"model:={model}", "-p", f"path:={path}", "-p", "points:=40", *ACHIEVED),
    )
    assert publisher.wait_for_exit() == 0
    assert "published 40 targets" in publisher.log


def test_refused_targets_make_the_exit_code_1(launch: Callable[..., Any]) -> None:
    """The gantry's path, sent to an arm."""
    for node in ("ik_node", "fake_robot"):
        launch(node, "-p", "model:=ur5e")
    publisher = launch("target_publisher", *ACHIEVED)
    assert publisher.wait_for_exit() == 1
    (fatal,) = [line for line in publisher.log.splitlines() if "[FATAL]" in line]
    assert "15 targets" in fatal and "0 on /accepted_target" in fatal
    assert "Traceback" not in publisher.log


def test_a_robot_that_does_not_move_makes_the_exit_code_1(launch: Callable[..., Any]) -> None:
    """Commands for another robot are refused by the robot, though no target is."""
    launch("ik_node", *QUEUE)
    launch("fake_robot", "-p", "model:=ur5e", "-p", "joint_state_rate:=0.0")
    publisher = launch("target_publisher", *ACHIEVED)
    assert publisher.wait_for_exit() == 1
    assert "15 on /accepted_target, 0 on /tracking_error/position" in publisher.log


def test_results_of_two_robots_are_not_taken_for_those_of_one(launch: Callable[..., Any]) -> None:
    for _ in range(2):
        launch("ik_node", *QUEUE)
    publisher = launch(
        "target_publisher",
        *("-p", "expected_results:=accepted", "-p", "wait_timeout:=5.0"),
        ready=False,
    )
    assert publisher.wait_for_exit() == 1
    assert "2 of 1 publishers on /accepted_target" in publisher.log
    assert "published" not in publisher.log


def test_a_model_that_is_missing_ends_the_node(launch: Callable[..., Any]) -> None:
    publisher = launch("target_publisher", "-p", "model:=no.onnx", ready=False)
    assert publisher.wait_for_exit() == 1
    assert "no.onnx" in publisher.log and "Traceback" not in publisher.log

"""What happens to the model file while it is served."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from invariants import (
    assert_every_command_belongs_to_a_target,
    connect,
    good_target,
    wait_for_counts,
)
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from annik_core.installation import default_model_path


def _truncate(model: Path, _: Path) -> None:
    os.truncate(model, 100)


def _remove(model: Path, _: Path) -> None:
    model.unlink()


def _replace(model: Path, other: Path) -> None:
    os.replace(shutil.copy(other, model.with_name("next.onnx")), model)


def _overwrite(model: Path, _: Path) -> None:
    with model.open("r+b") as file:
        file.write(b"\xff" * model.stat().st_size)


def _put_a_folder_there(model: Path, _: Path) -> None:
    model.unlink()
    model.mkdir()


FAULTS = (_truncate, _remove, _replace, _overwrite, _put_a_folder_there)


def test_what_is_served_is_what_was_checked_whatever_becomes_of_the_file(
    launch: Callable[..., Any], client: Any, tmp_path: Path, other_robots_model: Path
) -> None:
    """The same answers to the last bit, and a reload that says why it was refused."""
    model = tmp_path / "model.onnx"
    shutil.copy(default_model_path(), model)
    launch("ik_node", "-p", f"model:={model}", "-p", "queue_depth:=100")
    connect(client)
    client.send(good_target(0))
    client.wait_for_results(good_target(0), ["joint_command"])
    positions = list(client.received["joint_command"][-1].position)
    for fault in FAULTS:
        fault(model, other_robots_model)
        for reload in (False, True):
            if reload:
                response = client.call("ik_node/reload_model")
                assert not response.success, fault.__name__
                assert response.message.startswith(f"still serving {model}")
            before = len(client.received["joint_command"])
            client.send(good_target(0))
            client.wait_until(
                lambda before=before: len(client.received["joint_command"]) > before, "an answer"
            )
            assert list(client.received["joint_command"][-1].position) == positions
        if model.is_dir():
            model.rmdir()
        model.unlink(missing_ok=True)
        shutil.copy(default_model_path(), model)
    assert client.call("ik_node/reload_model").success
    client.send(good_target(1))
    client.wait_for_results(good_target(1), ["joint_command"])


def test_reloads_in_the_middle_of_a_stream_lose_no_target(
    launch: Callable[..., Any], client: Any
) -> None:
    """Good reloads and refused ones: each target is answered once, by one model or the other.

    Of three hundred calls at once each has a response too: one reloads, or says that one is busy.
    """
    launch("ik_node", "-p", "queue_depth:=10000")
    contacts = connect(client)
    service = client.node.create_client(
        Trigger, "ik_node/reload_model", qos_profile=QoSProfile(depth=1000)
    )
    client.wait_until(service.service_is_ready, "the service")
    targets = [good_target(number) for number in range(1, 301)]
    for number, target in enumerate(targets):
        client.send(target)
        if number % 60 == 30:
            path = "" if number % 120 == 30 else "/nowhere.onnx"
            assert client.set_parameter("ik_node", "model", path).successful
            assert client.call("ik_node/reload_model").success == (not path)
    storm = [service.call_async(Trigger.Request()) for _ in range(300)]
    client.wait_until(lambda: all(call.done() for call in storm), "all responses")
    beginnings = {call.result().message.partition(" ")[0] for call in storm}
    assert beginnings == {"now", "busy:"}
    client.wait_until(lambda: len(client.received["accepted_target"]) == 300, "all answers")
    assert wait_for_counts(client, contacts + 300).refused == 0
    assert_every_command_belongs_to_a_target(client, [good_target(0), *targets])
    accepted = [message.pose.position.x for message in client.received["accepted_target"]]
    np.testing.assert_array_equal(accepted, [target[0] for target in targets])

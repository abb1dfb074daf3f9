"""Parameter files that are wrong, and one that is right, for a node of another name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseArray
from invariants import GOOD, counts_in, path_message
from trajectory_msgs.msg import JointTrajectory

WRONG = {
    "no such file": (None, "missing.yaml"),
    "no YAML": ("ik_node: [1, 2", "no_YAML"),
    "binary": ("\x00\x01\x02", "binary"),
    "wrong type": ("ik_node: {ros__parameters: {max_joint_step: [1.0]}}", "max_joint_step"),
    "contradiction": (
        "ik_node: {ros__parameters: {workspace_box_lower: [1.0, 1.0, 1.0], "
        "workspace_box_upper: [0.0, 2.0, 2.0]}}",
        "less than workspace_box_upper",
    ),
}


def test_a_bad_parameter_file_ends_the_node_with_one_clear_line(
    launch: Callable[..., Any], tmp_path: Path
) -> None:
    """Exit code 1, and what is wrong: the file, or the parameter with what is allowed."""
    nodes = {}
    for number, (name, (content, _)) in enumerate(WRONG.items()):
        path = tmp_path / f"{name.replace(' ', '_')}.yaml"
        if content is None:
            path = tmp_path / "missing.yaml"
        else:
            path.write_text(content, encoding="utf-8")
        nodes[name] = launch("ik_node", "--params-file", str(path), ready=False)
        # All at once they would only wait for each other.
        if number % 3 == 2:
            for node in nodes.values():
                node.wait_for_exit()
    for name, node in nodes.items():
        assert node.wait_for_exit() == 1, name
        fatal = [line for line in node.log.splitlines() if "[FATAL]" in line]
        assert len(fatal) == 1, f"{name}: {node.log}"
        assert WRONG[name][1] in node.log, f"{name}: {node.log}"
        assert "Traceback" not in node.log, name


def test_parameters_topics_and_services_follow_the_node_into_its_namespace(
    launch: Callable[..., Any], make_client: Callable[..., Any], tmp_path: Path
) -> None:
    """Under another name and with remapped topics; parameters for a namesake are not its own."""
    path = tmp_path / "parameters.yaml"
    path.write_text(
        "/**: {ros__parameters: {queue_depth: 100}}\n"
        "/cell/solver: {ros__parameters: {max_path_poses: 2, publish_joint_trajectory: true}}\n"
        "/cell/ik_node: {ros__parameters: {on_refusal: nonsense}}\n",
        encoding="utf-8",
    )
    launch(
        *("ik_node", "-r", "__ns:=/cell", "-r", "__node:=solver", "--params-file", str(path)),
        *("-r", "target_poses:=paths", "-r", "joint_trajectory:=/arm/trajectory"),
        *("-r", "joint_command:=/arm/command", "-r", "accepted_target:=/cell/taken"),
    )
    client = make_client(namespace="/cell")
    client.listen("/arm/trajectory", JointTrajectory)
    trajectories = client.received["/arm/trajectory"]
    paths = client.node.create_publisher(PoseArray, "paths", 10)
    client.wait_until(paths.get_subscription_count, "the node listens")
    sent: list[PoseArray] = []

    def send_path() -> None:
        sent.append(path_message([GOOD, GOOD]))
        paths.publish(sent[-1])

    client.repeat_until(send_path, lambda: trajectories, "a trajectory")
    paths.publish(path_message([GOOD] * 3))
    _, values = client.wait_for_status(
        "cell/solver", lambda values: "3 poses" in values.get("last refusal", ""), "a refusal"
    )
    counts = counts_in(values)
    assert counts.reasons == {"path length": 1}
    assert counts.received <= len(sent) + 1
    before = len(trajectories)
    client.send(GOOD)
    client.wait_until(lambda: len(trajectories) > before, "the command as a trajectory")
    assert not client.received["joint_command"]
    assert client.call("solver/reload_model").success
    assert client.change_state("solver", "deactivate")
    assert client.set_parameter("solver", "max_path_poses", 5).successful

"""Parameters of running nodes through the ways of ROS tools: dump, load, file, set."""

from __future__ import annotations

import math
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python
from support.collection_plans import small_plan

from annik_core.dataset import save_dataset
from annik_core.robots.library import load_robot
from docs.parameter_tables import PARAMETER_TABLES


def values_of(client: Any, node: str) -> dict[str, ParameterValue]:
    """The parameters of a node, with their types."""
    names = [row.name for row in PARAMETER_TABLES[node]]
    request = GetParameters.Request(names=names)
    response = client.request(GetParameters, f"{node}/get_parameters", request)
    return dict(zip(names, response.values, strict=True))


def dump(client: Any, node: str, path: Path) -> dict[str, ParameterValue]:
    """What ``ros2 param dump`` does."""
    values = values_of(client, node)
    plain = {}
    for name, value in values.items():
        python = parameter_value_to_python(value)
        plain[name] = python if isinstance(python, (bool, int, float, str)) else list(python)
    text = yaml.dump({f"/{node}": {"ros__parameters": plain}}, default_flow_style=False)
    path.write_text(text, encoding="utf-8")
    return values


def load(client: Any, node: str, path: Path) -> dict[str, Any]:
    """What ``ros2 param load`` does; the results by name."""
    given = parameter_dict_from_yaml_file(str(path), target_nodes=[f"/{node}"])
    request = SetParameters.Request(parameters=list(given.values()))
    response = client.request(SetParameters, f"{node}/set_parameters", request)
    return dict(zip(given, response.results, strict=True))


def test_the_parameters_of_a_running_ik_node_are_restored(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """The defaults, and limits that ``ros2 param load`` hands on as strings or integers."""
    launch("ik_node")
    settable = {row.name for row in PARAMETER_TABLES["ik_node"] if not row.read_only}
    defaults = dump(client, "ik_node", tmp_path / "defaults.yaml")
    changed = {
        "max_position_residual": 5e-5,
        "max_joint_velocity": 2.5,
        "max_joint_step": 1,
        "refinement_tolerance": 1e-7,
        "max_first_step": math.inf,
        "max_target_age": math.inf,
        "workspace_box_lower": [0.0, -1.0, -math.inf],
        "workspace_box_upper": [0.5, 1.0, 0.8],
        "mode": "refined",
    }
    for name, value in changed.items():
        result = client.set_parameter("ik_node", name, value)
        assert result.successful, f"{name}: {result.reason}"
    others = dump(client, "ik_node", tmp_path / "others.yaml")
    assert others["max_joint_step"].double_value == 1.0
    assert others["max_target_age"].double_value == 0.0
    assert {name for name in others if others[name] != defaults[name]} == {
        *changed,
    } - {"max_target_age"}
    for path, expected in (("defaults.yaml", defaults), ("others.yaml", others)):
        results = load(client, "ik_node", tmp_path / path)
        refused = {name for name, result in results.items() if not result.successful}
        assert refused == set(results) - settable
        assert values_of(client, "ik_node") == expected


def test_no_string_sets_a_safety_limit(launch: Callable[..., Any], client: Any) -> None:
    """It is an error, and the limit stays; at the start it ends the node."""
    launch("ik_node", "-p", "max_joint_velocity:=2.5")
    for text in ("fast", "2.5", "", "1e-3", "[1.0]", "true"):
        result = client.set_parameter("ik_node", "max_joint_velocity", text)
        assert not result.successful, text
        assert result.reason, text
    assert values_of(client, "ik_node")["max_joint_velocity"].double_value == 2.5
    other = launch("ik_node", "-p", "max_joint_velocity:='2.5'", ready=False)
    assert other.wait_for_exit() == 1
    assert "max_joint_velocity" in other.log


def test_a_dump_of_each_node_starts_the_same_node(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """Its parameters are equal and of the same types."""
    plan = tmp_path / "plan.npz"
    save_dataset(small_plan(load_robot("ur5e")), plan)
    given = {
        "fake_robot": ("robot:=ur5e", "imperfection_seed:=3", "backlash:=0.001"),
        "target_publisher": ("wait_timeout:=.inf", "rate:=20"),
        "bag_recorder": (f"output:={tmp_path / 'bag'}", "topics:=[/diagnostics, joint_states]"),
        "example_collector": (f"plan:={plan}", f"dataset:={tmp_path / 'measured.npz'}"),
        "viewer": ("model:=ur5e", "port:=8490", "drive:=true"),
    }
    before = {}
    for node, parameters in given.items():
        arguments = [word for one in parameters for word in ("-p", one)]
        process = launch(node, *arguments, ready=False)
        before[node] = dump(client, node, tmp_path / f"{node}.yaml")
        process.signal(signal.SIGTERM)
        process.wait_for_exit()
    shutil.rmtree(tmp_path / "bag")
    for node, values in before.items():
        launch(node, "--params-file", str(tmp_path / f"{node}.yaml"), ready=False)
        assert values_of(client, node) == values

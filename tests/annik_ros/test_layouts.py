"""The layouts for RViz, PlotJuggler and Foxglove: what they show is what the nodes publish.

None of these programs can be run in a test. The layouts parse, every topic in them is one of the
nodes, with the type that its display takes, and every field of a curve is one of that type.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import Nodetype
from support.robot_recording import START_NS

from annik_core.installation import share_directory
from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.writer import BagWriter
from msg_tools.topics import TOPICS

CONFIG = share_directory() / "config"
TYPES = {f"/{topic.name.lstrip('/')}": topic.type for topic in TOPICS}
#: Display of RViz or layer of Foxglove to the type of message that it takes.
TAKEN = {
    "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
    "rviz_default_plugins/Pose": "geometry_msgs/msg/PoseStamped",
    "foxglove.Urdf": "std_msgs/msg/String",
}
WITHOUT_TOPIC = {"rviz_default_plugins/Grid", "rviz_default_plugins/TF", "foxglove.Grid"}
PANELS = {"3D", "Plot", "DiagnosticSummary"}


def topic_and_fields(path: str, separator: str) -> tuple[str, list[str]]:
    """The topic and the fields of the name of a curve, such as ``/a/b.vector.x``."""
    topic = max((name for name in TYPES if path.startswith(name + separator)), key=len)
    return topic, path[len(topic) + 1 :].split(separator)


def check_fields(message_type: str, fields: list[str]) -> None:
    """Each is a field of the message before it, and the last a number."""
    for field in fields:
        name, index = re.fullmatch(r"(\w+)(\[:\])?", field).groups()
        members = dict(jazzy_types().fielddefs[message_type][1])
        of = members[name][1]
        if index:
            of = of[0][1]
        message_type = of if isinstance(of, str) else of[0]
    assert message_type in ("float64", "float32"), fields


def displays() -> list[dict[str, Any]]:
    layout = yaml.safe_load((CONFIG / "annik.rviz").read_text(encoding="utf-8"))
    found: list[dict[str, Any]] = layout["Visualization Manager"]["Displays"]
    return found


@pytest.mark.parametrize("display", displays(), ids=lambda display: display["Class"])
def test_displays_of_rviz_take_what_is_published(display: dict[str, Any]) -> None:
    topic = display.get("Topic") or display.get("Description Topic")
    if display["Class"] in WITHOUT_TOPIC:
        assert topic is None
        return
    assert TYPES[topic["Value"]] == TAKEN[display["Class"]]
    # Whoever publishes a latched topic may have done so before RViz began.
    latched = topic["Value"] == "/robot_description"
    assert topic["Durability Policy"] == ("Transient Local" if latched else "Volatile")


def test_curves_of_plotjuggler_are_fields_of_what_is_published() -> None:
    layout = ElementTree.parse(CONFIG / "plotjuggler.xml")
    curves = [curve.attrib["name"] for curve in layout.iter("curve")]
    assert len(curves) == len(set(curves)) == 12
    for curve in curves:
        topic, fields = topic_and_fields(curve, "/")
        check_fields(TYPES[topic], fields)
    for splitter in layout.iter("DockSplitter"):
        assert len(splitter.attrib["sizes"].split(";")) == len(splitter)
        assert int(splitter.attrib["count"]) == len(splitter)


def foxglove() -> dict[str, Any]:
    layout: dict[str, Any] = json.loads((CONFIG / "foxglove.json").read_text(encoding="utf-8"))
    return layout


def panels(node: str | dict[str, Any]) -> Iterator[str]:
    """The names of the panels in a division of the window."""
    if isinstance(node, str):
        yield node
    else:
        assert node["direction"] in ("row", "column")
        yield from panels(node["first"])
        yield from panels(node["second"])


def test_panels_of_foxglove_are_all_shown() -> None:
    layout = foxglove()
    shown = list(panels(layout["layout"]))
    assert sorted(shown) == sorted(layout["configById"])
    assert {name.partition("!")[0] for name in shown} == PANELS


def test_panels_of_foxglove_show_what_is_published() -> None:
    seen = set()
    for name, panel in foxglove()["configById"].items():
        for path in panel.get("paths", ()):
            topic, fields = topic_and_fields(path["value"], ".")
            check_fields(TYPES[topic], fields)
        for topic in panel.get("topics", ()):
            assert TYPES[topic] == "geometry_msgs/msg/PoseStamped"
        for layer in panel.get("layers", {}).values():
            if layer["layerId"] not in WITHOUT_TOPIC:
                assert TYPES[layer["topic"]] == TAKEN[layer["layerId"]]
                assert TYPES[layer["jointStatesTopic"]] == "sensor_msgs/msg/JointState"
        if name.startswith("DiagnosticSummary"):
            assert TYPES[panel["topicToRender"]] == "diagnostic_msgs/msg/DiagnosticArray"
        seen.add(name.partition("!")[0])
    assert seen == PANELS


def test_a_bag_has_the_schema_of_every_topic(tmp_path: Any) -> None:
    """Foxglove and PlotJuggler know the messages from the file alone."""
    types = jazzy_types()
    with BagWriter(tmp_path / "bag") as writer:
        for name, message_type in TYPES.items():
            writer.add_topic(name, message_type)
            cdr = types.serialize_cdr(empty(message_type), message_type)
            writer.write(name, bytes(cdr), START_NS, START_NS)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = {
            channel.topic: (schema.name, schema.encoding)
            for schema, channel, _, _ in reader.iter_decoded_messages()
        }
    assert read == {name: (message_type, "ros2msg") for name, message_type in TYPES.items()}


def empty(message_type: str) -> Any:
    """A message with zeros, and no elements."""
    types = jazzy_types()

    def value(kind: Nodetype, of: Any) -> Any:
        if kind == Nodetype.NAME:
            return empty(of)
        if kind == Nodetype.BASE:
            return {"string": "", "bool": False}.get(of[0], 0)
        return np.zeros(0) if of[0][1][0] == "float64" else []

    fields = types.fielddefs[message_type][1]
    return types.types[message_type](*(value(kind, of) for _, (kind, of) in fields))

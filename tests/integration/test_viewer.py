"""viewer: shows the robot of the graph, and moves it while its switch is on."""

from __future__ import annotations

import re
import signal
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page needs viser: pip install 'annik_ros[view]'")

import msgspec
import viser
import zstandard
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Pose
from support.collection_plans import small_plan
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from annik_core.dataset import save_dataset
from annik_core.robots.library import load_robot
from annik_ros.diagnostics import ROWS_MEASURED
from msg_tools.topics import TOPICS

UR5E = ("-p", "model:=ur5e")
DRIVE = "drive the robot"


class Browser:
    """Says to a page what a browser would say, by the protocol of viser."""

    def __init__(self, url: str) -> None:
        protocol: Any = f"viser-v{viser.__version__}"
        self._connection = connect(
            url.replace("http://", "ws://"),
            subprotocols=[protocol],
            max_size=None,
            compression=None,
        )
        self.switches: dict[str, str] = {}
        self.words = ""
        threading.Thread(target=self._receive, daemon=True).start()
        # viser calls nothing back for a client that has not said where it looks from.
        self._send(
            "ViewerCameraMessage",
            wxyz=[1.0, 0.0, 0.0, 0.0],
            position=[2.0, 0.0, 0.0],
            fov=1.0,
            near=0.1,
            far=100.0,
            image_height=480,
            image_width=640,
            look_at=[0.0, 0.0, 0.0],
            up_direction=[0.0, 0.0, 1.0],
        )

    def switch(self, label: str, on: bool) -> None:
        """Set a checkbox."""
        self._send("GuiUpdateMessage", uuid=self.switches[label], updates={"value": on})

    def drag(self, pose: np.ndarray) -> None:
        """Move the target to a pose ``(7,)``."""
        x, y, z, qx, qy, qz, qw = pose.tolist()
        self._send(
            "TransformControlsUpdateMessage",
            name="/target",
            position=[x, y, z],
            wxyz=[qw, qx, qy, qz],
        )

    def close(self) -> None:
        self._connection.close()

    def _send(self, kind: str, **content: object) -> None:
        self._connection.send(msgspec.msgpack.encode({"type": kind, **content}))

    def _receive(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                data = self._connection.recv()
                assert isinstance(data, bytes)
                _, size = struct.unpack_from("<QQ", data)
                inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
                for message in msgspec.msgpack.decode(inner)["messages"]:
                    self._take(message)

    def _take(self, message: Mapping[str, Any]) -> None:
        if message["type"] == "GuiCheckboxMessage":
            self.switches[message["props"]["label"]] = message["uuid"]
        content = message.get("updates", {}).get("content", "")
        if "annik-readout" in content:
            self.words = content


@pytest.fixture
def open_page() -> Iterator[Callable[[Any], Browser]]:
    """Open the page of a viewer."""
    opened: list[Browser] = []

    def start(viewer: Any) -> Browser:
        (url,) = re.findall(r"open (http://\S+)", viewer.log)
        opened.append(Browser(url.replace("0.0.0.0", "127.0.0.1")))
        return opened[-1]

    yield start
    for browser in opened:
        browser.close()


def test_a_dragged_target_moves_the_robot_only_while_the_switch_is_on(
    launch: Callable[..., Any], client: Any, open_page: Callable[[Any], Browser]
) -> None:
    launch("ik_node", *UR5E)
    launch("fake_robot", *UR5E)
    sent: list[Pose] = client.received.setdefault("target_pose", [])
    client.listen("target_pose", Pose)
    viewer = launch("viewer", *UR5E, "-p", "port:=8460", "-p", "drive:=true")
    page = open_page(viewer)
    client.wait_until(lambda: DRIVE in page.switches, "the page has its switch")
    client.wait_until(lambda: client.received["joint_states"], "joint states")
    robot = load_robot("ur5e")
    state = client.received["joint_states"][-1]
    start = robot.forward_kinematics.poses(np.array([state.position]))[0]
    goal = start + np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.0])

    def words_have(position: np.ndarray) -> bool:
        return ", ".join(f"{value:.3f}" for value in position.tolist()) in page.words

    client.repeat_until(
        lambda: page.drag(goal), lambda: words_have(goal[:3]), "the target is dragged"
    )
    client.take_messages(0.3)
    assert not sent and not client.received["accepted_target"]

    page.switch(DRIVE, True)
    client.wait_until(lambda: "moves the robot" in page.words, "the page says that it drives")
    client.repeat_until(
        lambda: page.drag(goal), lambda: client.received["achieved_pose"], "the robot moves"
    )
    at = client.received["achieved_pose"][-1].pose.position
    np.testing.assert_allclose([at.x, at.y, at.z], goal[:3], atol=1e-4)
    client.repeat_until(
        lambda: page.drag(goal),
        lambda: "tracking error" in page.words,
        "the tracking error is shown",
    )

    page.switch(DRIVE, False)
    client.wait_until(lambda: "moves the robot" not in page.words, "the page says that it stops")
    client.take_the_rest()
    count = len(sent)
    client.repeat_until(lambda: page.drag(start), lambda: words_have(start[:3]), "a drag is shown")
    client.take_messages(0.3)
    assert len(sent) == count
    viewer.signal(signal.SIGINT)
    assert viewer.wait_for_exit() == 0
    assert "Traceback" not in viewer.log


def test_the_page_follows_the_collection_of_a_plan(
    launch: Callable[..., Any],
    client: Any,
    open_page: Callable[[Any], Browser],
    tmp_path: Path,
) -> None:
    plan = tmp_path / "plan.npz"
    save_dataset(small_plan(load_robot("ur5e"), examples=9), plan)
    viewer = launch("viewer", "-p", f"plan:={plan}", "-p", "port:=8480")
    page = open_page(viewer)
    client.wait_until(lambda: "9, 0 measured" in page.words, "the examples are shown")
    publisher = client.node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def report(rows: str) -> None:
        values = [KeyValue(key=ROWS_MEASURED, value=rows)]
        publisher.publish(DiagnosticArray(status=[DiagnosticStatus(values=values)]))

    client.repeat_until(
        lambda: report("0-2, 7"), lambda: "9, 4 measured" in page.words, "progress is shown"
    )
    report("nonsense")
    client.repeat_until(
        lambda: report("0-8"), lambda: "9, 9 measured" in page.words, "all are measured"
    )
    viewer.signal(signal.SIGINT)
    assert viewer.wait_for_exit() == 0


def test_the_page_only_shows_unless_it_may_drive(
    launch: Callable[..., Any], client: Any, open_page: Callable[[Any], Browser]
) -> None:
    remapped = ("-r", "joint_states:=/arm/states", "-r", "__ns:=/left")
    viewer = launch("viewer", *UR5E, "-p", "host:=0.0.0.0", "-p", "port:=8470", *remapped)
    documented = {f"/left/{topic.name}" for topic in TOPICS if "viewer" in topic.subscriber}
    heard = documented - {"/left//diagnostics", "/left/joint_states"} | {"/arm/states"}

    def topics() -> set[str]:
        found = client.node.get_subscriber_names_and_types_by_node("viewer", "/left")
        return {name for name, _ in found}

    client.wait_until(lambda: "viewer" in client.node.get_node_names(), "the node")
    client.wait_until(lambda: topics() == heard, "its topics, as documented and remapped")
    assert not client.node.count_publishers("/left/target_pose")
    page = open_page(viewer)
    client.wait_until(lambda: "all solutions" in page.switches, "the page is built")
    assert DRIVE not in page.switches
    viewer.signal(signal.SIGTERM)
    assert viewer.wait_for_exit() == 0

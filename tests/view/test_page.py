"""The page in a real browser, without a window."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.nodes import domain, launch

pytest.importorskip("viser", reason="the page needs viser: pip install 'annik_ros[view]'")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from annik_core.reachable_paths import start_positions
from annik_view.page import Page
from annik_view.solvers import solver_of
from annik_view.state import Examples, ViewState
from docs.browser import PATIENCE, browser, chromium, pixel

__all__ = ["domain", "launch"]

WIDTH, HEIGHT = 1000, 640
EXECUTABLE = chromium()
#: How long a page that changes nothing is watched [s].
QUIET = 0.5


@contextmanager
def running(page: Page) -> Iterator[Page]:
    thread = threading.Thread(target=page.run)
    thread.start()
    yield page
    page.close()
    thread.join(PATIENCE)
    assert not thread.is_alive()


@pytest.fixture
def page() -> Iterator[Page]:
    with running(Page(ViewState(solver_of("ur5e")), port=8301)) as shown:
        yield shown


def wait_for(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def colours_around(picture: bytes, at: tuple[float, float], half: int = 12) -> np.ndarray:
    import io

    from PIL import Image

    x, y = map(round, at)
    assert half < x < WIDTH - half and half < y < HEIGHT - half
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=int)
    return pixels[y - half : y + half, x - half : x + half].reshape(-1, 3)


@pytest.mark.process
def test_requests_replace_older_ones_of_their_kind(page: Page) -> None:
    goal = page.state.target.copy()
    for step in range(200):
        pose = goal + 1e-4 * step * np.array([0, 0, 1, 0, 0, 0, 0])
        page.request("target", lambda pose=pose: page.state.move_target(pose))
    wait_for(lambda: page.state.achieved[2] > goal[2] + 0.0198, "the newest target is reached")
    assert len(page.state.target_trail) < 200


@pytest.mark.process
def test_examples_change_their_colour_when_they_are_measured() -> None:
    solver = solver_of("ur5e")
    rows = solver.robot.joint_box.sample(4, np.random.default_rng(0))
    examples = Examples(rows, solver.robot.forward_kinematics.poses(rows)[:, :3])
    page = Page(ViewState(solver, follows=True, examples=examples), port=8321)
    with running(page):
        points = page.server.scene.get_handle_by_name("/examples")
        to_do = points.colors[0].tolist()
        assert (points.colors == to_do).all()
        with page.changing() as state:
            state.examples.measured = frozenset({1, 3})
        wait_for(lambda: (points.colors != to_do).any(), "the colours change")
        changed = (points.colors != to_do).any(axis=1)
        assert changed.tolist() == [False, True, False, True]


@pytest.fixture(scope="module")
def tab() -> Iterator[Any]:
    """A page of a browser, for one test after the other."""
    if EXECUTABLE is None:
        pytest.skip("no Chromium: apt install chromium")
    with browser(EXECUTABLE, WIDTH, HEIGHT) as page:
        yield page


def wait_until_drawn(tab: Any, camera: Any, point: np.ndarray) -> None:
    """What is drawn at a point is not of the colour of the background."""
    at = pixel(camera, point, WIDTH, HEIGHT)
    wait_for(
        lambda: (np.ptp(colours_around(tab.screenshot(), at), axis=0) > 40).any(),
        "the arm is drawn",
    )


def first_camera(state: ViewState) -> Any:
    """Where a page of this state, which is in another process, is looked at from at first."""
    page = Page(state, port=8341)
    page.server.stop()
    camera = page.server.initial_camera
    forwards = camera.look_at - camera.position
    right = np.cross(forwards, [0.0, 0.0, 1.0])
    axes = np.array([right, np.cross(forwards, right), forwards])
    x, y, z, w = Rotation.from_matrix(axes.T / np.linalg.norm(axes, axis=1)).as_quat()
    return SimpleNamespace(wxyz=(w, x, y, z), position=camera.position, fov=camera.fov)


def drag(tab: Any, camera: Any, reach: float, target: np.ndarray, distance: float) -> None:
    """Press the mouse on the longest arrow that is seen of the target, and move it along."""
    axes = Rotation.from_quat(target[3:]).as_matrix().T
    at = np.array(pixel(camera, target[:3], WIDTH, HEIGHT))
    # At the head of the arrow: an arc to turn the target is not far from its middle.
    tips = [target[:3] + 0.19 * reach * axis for axis in axes]
    seen = [math.dist(at, pixel(camera, tip, WIDTH, HEIGHT)) for tip in tips]
    axis, handle = axes[np.argmax(seen)], tips[np.argmax(seen)]
    tab.mouse.move(*pixel(camera, handle, WIDTH, HEIGHT))
    tab.mouse.down()
    for share in np.linspace(0.0, 1.0, 8):
        tab.mouse.move(*pixel(camera, handle + distance * share * axis, WIDTH, HEIGHT))


@pytest.mark.process
@pytest.mark.slow
def test_drag_refuse_and_click_in_chromium(page: Page, tab: Any) -> None:
    state = page.state
    tab.goto(page.url)
    tab.wait_for_selector(".annik-readout")
    wait_for(page.server.get_clients, "the page connects")
    (client,) = page.server.get_clients().values()
    wait_for(lambda: client.camera.update_timestamp > 0.0, "the page says where it looks from")

    def seen(point: np.ndarray) -> tuple[float, float]:
        return pixel(client.camera, point, WIDTH, HEIGHT)

    wait_until_drawn(tab, client.camera, state.posture().points[3])

    # Drag an arrow of the target: the arm follows, the numbers change.
    before, words = state.target.copy(), tab.inner_text(".annik-readout")
    drag(tab, client.camera, state.skeleton.reach, before, 0.06)
    wait_for(lambda: np.abs(state.target - before).max() > 0.02, "the target is dragged")
    tab.mouse.up()
    wait_for(lambda: tab.inner_text(".annik-readout") != words, "the numbers change")
    assert not state.refused
    np.testing.assert_allclose(state.achieved[:3], state.target[:3], atol=1e-5)

    # A target out of reach is refused, in words.
    near = state.target.copy()
    far = near + np.array([5.0, 0, 0, 0, 0, 0, 0])

    def refused() -> bool:
        # Again and again: the last motions of the mouse may come later than this.
        page.request("target", lambda: state.move_target(far))
        return "refused" in tab.inner_text(".annik-readout")

    wait_for(refused, "the refusal is shown")
    page.request("target", lambda: state.move_target(near))

    # All solutions are shown as ghosts, and a click on one takes it.
    tab.get_by_role("checkbox").first.click(force=True)  # check() would not wait for the page
    wait_for(lambda: len(page.ghosts) > 4, "the solutions are shown")
    before = state.joint_positions
    for solution in state.solutions[1:]:
        points = state.skeleton.posture(solution.joint_positions).points
        tab.mouse.click(*seen(0.5 * (points[2] + points[3])))
        time.sleep(QUIET)
        if state.joint_positions is not before:
            break
    assert any(state.joint_positions is one.joint_positions for one in state.solutions)


@pytest.mark.process
@pytest.mark.ros
@pytest.mark.slow
def test_the_target_moves_a_robot_on_ros_in_chromium(launch: Callable[..., Any], tab: Any) -> None:
    """While the switch is on; that the robot is there, its own tracking error says."""
    pytest.importorskip("rclpy")
    for node in ("ik_node", "fake_robot"):
        launch(node, "-p", "model:=ur5e")
    viewer = launch("viewer", "-p", "model:=ur5e", "-p", "port:=8331", "-p", "drive:=true")
    tab.goto(re.findall(r"open (http://\S+)", viewer.log)[0])
    state = ViewState(solver_of("ur5e"), follows=True)
    camera = first_camera(state)
    start = start_positions(state.robot)
    target = state.robot.forward_kinematics.poses(start[np.newaxis])[0]

    def readout() -> str:
        return str(tab.inner_text(".annik-readout"))

    at_start = ", ".join(f"{value:.3f}" for value in target[:3])
    wait_for(lambda: at_start in readout(), "the target is where the robot is")
    wait_until_drawn(tab, camera, state.skeleton.posture(start).points[3])
    tab.get_by_role("checkbox").first.click(force=True)  # check() would not wait for the page
    wait_for(lambda: "the target moves the robot" in readout(), "the switch is on")
    drag(tab, camera, state.skeleton.reach, target, 0.04)
    wait_for(
        lambda: "tracking error" in (words := readout()) and at_start not in words,
        "the robot has moved",
    )
    tab.mouse.up()

"""The page in a real browser, without a window."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page needs viser: pip install 'annik_ros[view]'")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from annik_view.page import Page
from annik_view.solvers import solver_of
from annik_view.state import Examples, ViewState
from docs.browser import PATIENCE, browser, chromium, pixel

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


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(EXECUTABLE is None, reason="no Chromium: apt install chromium")
def test_drag_refuse_and_click_in_chromium(page: Page) -> None:
    assert EXECUTABLE is not None
    state = page.state
    with browser(EXECUTABLE, WIDTH, HEIGHT) as tab:
        tab.goto(page.url)
        tab.wait_for_selector(".annik-readout")
        wait_for(page.server.get_clients, "the page connects")
        (client,) = page.server.get_clients().values()
        wait_for(lambda: client.camera.update_timestamp > 0.0, "the page says where it looks from")

        def seen(point: np.ndarray) -> tuple[float, float]:
            return pixel(client.camera, point, WIDTH, HEIGHT)

        # The arm is drawn: its elbow is not of the colour of the background.
        elbow = state.posture().points[3]
        wait_for(
            lambda: (np.ptp(colours_around(tab.screenshot(), seen(elbow)), axis=0) > 40).any(),
            "the arm is drawn",
        )

        # Drag the arrow of the z axis upwards: the arm follows, the numbers change.
        before, words = state.target.copy(), tab.inner_text(".annik-readout")
        upwards = np.array([0.0, 0.0, 1.0])
        axes = np.array([_turned(before[3:], axis) for axis in np.eye(3)])
        axis = axes[np.argmax(np.abs(axes @ upwards))]
        handle = before[:3] + 0.15 * state.skeleton.reach * axis
        tab.mouse.move(*seen(handle))
        tab.mouse.down()
        for share in np.linspace(0.0, 1.0, 8):
            tab.mouse.move(*seen(handle + 0.06 * share * axis))
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
        tab.get_by_role("checkbox").first.check(force=True)
        wait_for(lambda: len(page.ghosts) > 4, "the solutions are shown")
        before = state.joint_positions
        for solution in state.solutions[1:]:
            points = state.skeleton.posture(solution.joint_positions).points
            tab.mouse.click(*seen(0.5 * (points[2] + points[3])))
            time.sleep(QUIET)
            if state.joint_positions is not before:
                break
        assert any(state.joint_positions is one.joint_positions for one in state.solutions)


def _turned(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    turned: np.ndarray = Rotation.from_quat(quaternion).apply(vector)
    return turned

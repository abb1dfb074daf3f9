"""A page in the Chromium of this machine, without a window, for screenshots and tests."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

#: WebGL in software works with these, also in a container and without a graphics card.
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
#: Drawing in software on a busy machine takes tens of seconds [s].
PATIENCE = 180.0


def chromium() -> str | None:
    """The Chromium of this machine, or None."""
    names = "chromium", "chromium-browser", "google-chrome"
    return next(filter(None, map(shutil.which, names)), None)


@contextmanager
def browser(executable: str, width: int = 1100, height: int = 700) -> Iterator[Any]:
    """A page of Playwright in a new browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=executable, args=list(FLAGS), timeout=1e3 * PATIENCE
        )
        page = started.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(1e3 * PATIENCE)
        yield page
        started.close()


def pixel(camera: Any, point: np.ndarray, width: int, height: int) -> tuple[float, float]:
    """Where a camera of viser shows a point ``(3,)`` [m] on a page of this size."""
    w, *vector = camera.wxyz
    cross = np.cross(np.eye(3), vector)
    # From the camera's axes to those of the scene; z is forwards, y is down.
    axes = np.eye(3) + 2.0 * (w * cross + cross @ cross)
    x, y, z = axes.T @ (point - camera.position)
    focal = 0.5 * height / np.tan(0.5 * camera.fov)
    return 0.5 * width + focal * x / z, 0.5 * height + focal * y / z

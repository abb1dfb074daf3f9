"""Pictures of the page in the browser, for the documentation: `./run screenshots`."""

import sys
import threading
import time
from collections.abc import Callable, Mapping

from annik_core.installation import share_directory
from annik_core.robots.library import load_robot
from annik_training.designs.registry import generate_dataset
from annik_view.page import Page
from annik_view.solvers import solver_for, solver_of
from annik_view.state import Examples, ViewState
from docs.browser import PATIENCE, browser, chromium

WIDTH, HEIGHT = 1100, 640
IMAGES = share_directory() / "docs" / "images"
#: What is drawn in software is complete after this time [s].
DRAWN = 6.0


def solutions(page: Page) -> None:
    """Show all solutions, after the target has moved on a path."""
    state = page.state
    state.start_path("eight")
    while (target := state.next_target()) is not None and state.path_index < 100:
        state.move_target(target)
    state.stop_path()
    state.find_solutions()


def refused(page: Page) -> None:
    """Ask for a target out of reach."""
    target = page.state.target.copy()
    # Beside the arm, where the panel is not.
    target[:3] = [-0.72, -0.5, 0.75]
    page.state.move_target(target)


def arm() -> ViewState:
    """An arm alone."""
    return ViewState(solver_of("ur5e"))


def design() -> ViewState:
    """A design of experiments, as ``annik design --view`` shows it."""
    dataset = generate_dataset(load_robot("ur5e"), "sobol", 100, seed=0)
    examples = Examples(dataset.joint_positions, dataset.poses[:, :3])
    return ViewState(solver_for(dataset.robot), examples=examples)


SHOTS: Mapping[str, tuple[Callable[[], ViewState], Callable[[Page], None]]] = {
    "view_solutions": (arm, solutions),
    "view_refused": (arm, refused),
    "view_examples": (design, lambda page: page.state.show_example(7)),
}


def main() -> None:
    """Write the pictures."""
    executable = chromium()
    if executable is None:
        sys.exit("no Chromium: sudo apt install chromium")
    for name, (state, change) in SHOTS.items():
        page = Page(state(), port=8501)
        thread = threading.Thread(target=page.run)
        thread.start()
        with browser(executable, WIDTH, HEIGHT) as tab:
            tab.goto(page.url)
            tab.wait_for_selector(".annik-readout")
            page.request("picture", lambda change=change, page=page: change(page))
            page.request("gizmo", page.place_gizmo)
            time.sleep(DRAWN)
            notice = tab.locator(".mantine-Notification-closeButton")
            if notice.count():
                notice.first.click()
                time.sleep(1.0)
            tab.screenshot(path=IMAGES / f"{name}.png", timeout=1e3 * PATIENCE)
        page.close()
        thread.join(PATIENCE)
        print(IMAGES / f"{name}.png")


if __name__ == "__main__":
    main()

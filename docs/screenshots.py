"""Pictures of the page in the browser, for the documentation: `./run screenshots`."""

import sys
import threading
import time

from annik_core.installation import share_directory
from annik_view.page import Page
from annik_view.solvers import solver_of
from annik_view.state import ViewState
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
    target[:3] = [-0.85, -0.68, 0.45]
    page.state.move_target(target)


SHOTS = {"view_solutions": solutions, "view_refused": refused}


def main() -> None:
    """Write the pictures."""
    executable = chromium()
    if executable is None:
        sys.exit("no Chromium: sudo apt install chromium")
    for name, change in SHOTS.items():
        page = Page(ViewState(solver_of("ur5e")), port=8501)
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

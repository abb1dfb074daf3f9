"""``annik view``: a robot in the browser, with a target to drag."""

from contextlib import suppress

import click

from annik_view.meshes import link_meshes
from annik_view.page import Page
from annik_view.server import LOCALHOST, PORT, is_local, open_to_others
from annik_view.solvers import solver_of
from annik_view.state import ViewState


@click.command()
@click.argument("robot")
@click.option("--base-frame", help="Of a URDF: the link in which poses are given.")
@click.option("--end-effector-frame", help="Of a URDF: the link whose pose is given.")
@click.option("--host", default=LOCALHOST, show_default=True, help="Address of the page.")
@click.option("--port", default=PORT, show_default=True, help="The first free one from this on.")
def view(
    robot: str, base_frame: str | None, end_effector_frame: str | None, host: str, port: int
) -> None:
    """Show a robot in the browser, with a target to drag.

    ROBOT is a packaged robot, a model file (.onnx), a definition (.yaml) or a URDF (.urdf). Ctrl-C
    ends it.
    """
    solver = solver_of(robot, base_frame=base_frame, end_effector_frame=end_effector_frame)
    if not is_local(host):
        click.echo(f"warning: {open_to_others(host)}", err=True)
    show_page(ViewState(solver, meshes=link_meshes(robot)), host=host, port=port)


def show_page(state: ViewState, host: str = LOCALHOST, port: int = PORT) -> None:
    """Show a page until Ctrl-C."""
    page = Page(state, host=host, port=port)
    click.echo(f"open {page.url} in a browser; Ctrl-C ends it")
    with suppress(KeyboardInterrupt):
        page.run()

"""``annik report``: the tracking error recorded in a bag."""

from pathlib import Path

import click

from annik_core.files import write_file
from annik_training.cli.output import shown_progress
from msg_tools.report.table import print_report
from msg_tools.report.write import write_report

_PATH = click.Path(path_type=Path)


@click.command()
@click.argument("bag", type=_PATH)
@click.option("--out", type=_PATH, help="Folder for the report; default: report/ in the bag.")
@click.option(
    "--html", type=_PATH, help="Write an interactive page too: plots to zoom, in one file."
)
@click.option("--namespace", help="Namespace of the robot, if the bag holds several.")
def report(bag: Path, out: Path | None, html: Path | None, namespace: str | None) -> None:
    """Report the tracking error in a bag: tables here, plots in report.html."""
    if html is not None:
        # First: without plotly nothing is computed in vain.
        from msg_tools.report.interactive import interactive_page
    folder = out or (bag if bag.is_dir() else bag.parent) / "report"
    written = write_report(bag, folder, namespace, shown_progress)
    print_report(written)
    click.echo(f"report: {folder / 'report.html'}")
    if html is not None:
        write_file(html, interactive_page(written))
        click.echo(f"interactive report: {html}")

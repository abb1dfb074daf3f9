"""``annik report``: the tracking error recorded in a bag."""

from pathlib import Path

import click

from msg_tools.report.table import print_report
from msg_tools.report.write import write_report

_PATH = click.Path(path_type=Path)


@click.command()
@click.argument("bag", type=_PATH)
@click.option("--out", type=_PATH, help="Folder for the report; default: report/ in the bag.")
@click.option("--namespace", help="Namespace of the robot, if the bag holds several.")
def report(bag: Path, out: Path | None, namespace: str | None) -> None:
    """Report the tracking error in a bag: tables here, plots in report.html."""
    folder = out or (bag if bag.is_dir() else bag.parent) / "report"
    print_report(write_report(bag, folder, namespace))
    click.echo(f"report: {folder / 'report.html'}")

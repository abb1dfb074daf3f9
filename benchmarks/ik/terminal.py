"""The tables in the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.ik.results import BenchResults
from benchmarks.ik.tables import bench_tables


def print_results(results: BenchResults, console: Console) -> None:
    """All tables, the best cells in bold, then the solvers that did not take part."""
    for bench_table in bench_tables(results):
        # Escaped, as a unit in brackets is markup to rich.
        table = Table(title=bench_table.title, title_justify="left")
        for number, heading in enumerate(bench_table.columns):
            table.add_column(
                escape(heading),
                justify="right" if number > 1 else "left",
                no_wrap=number < 2,
            )
        for row in bench_table.rows:
            table.add_row(
                *(
                    f"[bold green]{escape(cell.text)}[/]" if cell.best else escape(cell.text)
                    for cell in row
                )
            )
        console.print(table)
    for name, found in results.targets.items():
        for fault, count in found.faults.items():
            console.print(escape(f"{name} failed {count} times: {fault}"), soft_wrap=True)
    for name, reason in results.skipped:
        console.print(escape(f"skipped {name}: {reason}"), soft_wrap=True)
    before, after = results.conditions.load_before, results.conditions.load_after
    console.print(f"load {before:.1f} before, {after:.1f} after; the benchmark itself is 1")

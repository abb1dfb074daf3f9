"""``./run bench``: all benchmarks by name."""

from __future__ import annotations

from importlib import import_module

import click

from benchmarks.command_line import run

#: Name to the module that has the command of that name, and what it measures.
BENCHMARKS = {
    "arms": ("benchmarks.arms", "Train the packaged arms anew and measure the models."),
    "fit_methods": ("benchmarks.fit_methods", "Ways to fit the paper's network."),
    "computed_examples": (
        "benchmarks.computed_examples",
        "How many computed examples a whole robot needs: minutes.",
    ),
    "solve_time": ("benchmarks.solve_time", "The time of a solve, part by part."),
    "learn_robot": ("benchmarks.learn_robot", "Calibrate simulated UR5es: an hour."),
    "calibrate": (
        "benchmarks.calibrate.command",
        "Calibrate real arms from public measurements, by annik and by others.",
    ),
    "ik": ("benchmarks.ik.command", "Inverse kinematics beside the solvers of others."),
    "install": ("benchmarks.install", "Install annik for every use, and try it: minutes."),
    "robots": ("benchmarks.robots.command", "Every URDF of a folder, within its joint limits."),
    "long_bag": ("benchmarks.long_bag", "Report a bag of a million messages: five minutes."),
    "view_page": ("benchmarks.view_page", "Drag the target of the page: twenty minutes."),
    "node": ("benchmarks.node.command", "ik_node beside a node that does nothing: half an hour."),
}
#: Run when no name is given.
SHORT = ("arms", "fit_methods", "solve_time")


class _Benchmarks(click.Group):
    """Loads a benchmark when it is run: each needs other libraries."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(BENCHMARKS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        if cmd_name not in BENCHMARKS:
            raise click.ClickException(f"no benchmark {cmd_name!r}: {', '.join(BENCHMARKS)}")
        command: click.Command = getattr(import_module(BENCHMARKS[cmd_name][0]), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Benchmarks"):
            formatter.write_dl([(name, meaning) for name, (_, meaning) in BENCHMARKS.items()])


@click.command(cls=_Benchmarks, invoke_without_command=True, subcommand_metavar="[NAME [OPTIONS]]")
@click.option("--quick", is_flag=True, help="Roughly; writes no documentation.")
@click.pass_context
def bench(context: click.Context, quick: bool) -> None:
    """Run a benchmark, or without a name those that take minutes.

    The tables go to build/, and with the standard settings to docs/results/ too.
    """
    if context.invoked_subcommand is not None:
        if quick:
            raise click.UsageError("give --quick after the name")
    else:
        for name in SHORT:
            command = bench.get_command(context, name)
            command.main(["--quick"] * quick, f"./run bench {name}", standalone_mode=False)


if __name__ == "__main__":
    run(bench, "./run bench")

"""``annik doctor``: check an installation."""

import subprocess
import sys

import click


@click.command()
def doctor() -> None:
    """Check this installation: libraries, ROS 2, models, a target over DDS."""
    # In a process of its own: training must not import ROS.
    sys.exit(subprocess.run([sys.executable, "-m", "annik_ros.doctor"], check=False).returncode)

"""What a benchmark ran on, for the line under its table."""

from annik_training.machine import machine as machine

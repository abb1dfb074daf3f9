"""Executors of rclpy, and the loop that drives any of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.task import Future

from annik_core.errors import AnnikError
from annik_ros.executor_choice import ExecutorChoice

#: Longest wait for work [s]. Jazzy's events executor calls nobody back unless its wait is finite.
_LONGEST_WAIT: Final = 0.5


def make_executor(choice: ExecutorChoice) -> Executor:
    """A new executor; rclpy's default one where this rclpy has no events executor yet."""
    if choice is ExecutorChoice.EVENTS:
        try:
            # Experimental, and not in the first releases of Jazzy.
            from rclpy.experimental.events_executor import EventsExecutor
        except ImportError:
            get_logger("executor").warning(
                "this rclpy has no events executor: single_threaded is used"
            )
        else:
            events: Executor = EventsExecutor()
            return events
    return SingleThreadedExecutor()


def spin(
    executor: Executor,
    finished: Future | None = None,
    on_error: Callable[[Exception], None] | None = None,
) -> None:
    """Call nodes back until ``finished`` is done or the context is shut down.

    Args:
        executor: has the nodes.
        finished: None: never.
        on_error: told of an error of a callback, of ours or of rclpy's own, after which the
            nodes go on; None: it is raised.

    Raises:
        AnnikError: from a callback, which ends the process on purpose.
        ExternalShutdownException: if the context is shut down while the executor waits.
    """
    while rclpy.ok() and not (finished is not None and finished.done()):
        try:
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
        except (AnnikError, ExternalShutdownException):
            raise
        except Exception as error:
            if on_error is None or not rclpy.ok():
                raise
            on_error(error)

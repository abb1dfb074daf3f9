"""The process of a node: signals, executor, exit code."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.task import Future

from annik_core.errors import AnnikError
from annik_ros.parameters import ExecutorChoice

#: Longest wait for work [s]. The events executor of Jazzy runs callbacks only with a finite wait.
_LONGEST_WAIT: Final = 0.5


class NotInTime(AnnikError):
    """What a node waits for did not come within a timeout.

    Attributes:
        missing: what is missing.
        timeout: how long the node waited [s].
    """

    def __init__(self, missing: str, timeout: float, remedy: str) -> None:
        self.missing = missing
        self.timeout = timeout
        super().__init__(f"{missing} after {timeout:g} s: {remedy}")


def make_executor(choice: ExecutorChoice) -> Executor:
    """A new executor; the default one of rclpy if it has no events executor."""
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
    """Run callbacks until ``finished`` is done or the context is shut down.

    Args:
        executor: has the nodes.
        finished: None: never.
        on_error: receives the error of a callback, after which the nodes continue; None: it is
            raised.

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


_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)

# An executor that a signal interrupts while it is made has no such attribute; its __del__ asks.
Executor._sigint_gc = None

AnyNode = TypeVar("AnyNode", bound=Node)


def initialise(name: str, args: list[str] | None = None) -> bool:
    """Initialise rclpy; False after one line on the fault of the command line.

    Args:
        name: name of the node, for the log.
        args: the command line; None means that of the process.
    """
    try:
        rclpy.init(args=args)
    except RuntimeError as error:
        # rclpy has no public class for faults of ROS arguments; there is no log yet.
        print(f"[FATAL] [{name}]: {one_line(error)}", file=sys.stderr)
        return False
    return True


def run_node(
    name: str,
    make_node: Callable[[], AnyNode],
    args: list[str] | None = None,
    finished: Callable[[AnyNode], Future] | None = None,
    executor: Callable[[AnyNode], Executor] = lambda _: SingleThreadedExecutor(),
    on_error: Callable[[AnyNode, Exception], None] | None = None,
) -> int:
    """Make a node and spin it until SIGINT, SIGTERM, its own end, or a fault.

    Args:
        name: name of the node in the log before it exists.
        make_node: makes it; may raise an :class:`AnnikError` for a fault of the set-up.
        args: the command line; None means that of the process.
        finished: the future of the node that is done when its work is; None: never.
        executor: makes the executor.
        on_error: receives the error of a callback, after which the node continues; None: it ends.

    Returns:
        The exit code: 0, or 1 after one line on the fault.
    """
    # Signals wait until everything is made: the middleware and the events executor would take
    # them for a fault, or end the process.
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    if not initialise(name, args):
        return 1
    node = None
    try:
        node = make_node()
        _spin(
            node,
            executor(node),
            finished(node) if finished else None,
            partial(on_error, node) if on_error else None,
        )
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (AnnikError, NameValidationException) as error:
        get_logger(name).fatal(one_line(error))
        return 1
    except RuntimeError:
        # A signal ends the context at once; what is being made or published then fails.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(
    node: Node,
    executor: Executor,
    finished: Future | None,
    on_error: Callable[[Exception], None] | None,
) -> None:
    # Later collections skip what exists now, so that they do not delay targets.
    gc.collect()
    gc.freeze()
    try:
        executor.add_node(node)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        spin(executor, finished, on_error)
    finally:
        executor.shutdown(timeout_sec=0.0)


def one_line(error: Exception) -> str:
    """The message of an error without line breaks."""
    return " ".join(str(error).split())

"""The process of a node: command line, executor, end, exit code."""

import gc
import inspect
import sys
from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from annik_core.errors import AnnikError, missing_dependency, one_line
from annik_ros.command_line import asks_for_help, check_arguments, help_text
from annik_ros.parameters import ExecutorChoice
from annik_ros.shared_memory import own_domain, remove_half_made
from annik_ros.signals import END_SIGNALS

#: Longest wait for work [s]. The events executor of Jazzy runs callbacks only with a finite wait.
_LONGEST_WAIT: Final = 0.5


class NotInTime(AnnikError):
    """What a node waits for did not come within a timeout."""

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


AnyNode = TypeVar("AnyNode", bound=Node)

#: What :func:`join` made, until the node itself is there.
_early: list[Node] = []


def join(name: str) -> None:
    """Begin to meet other nodes, before the node of this process is imported.

    They meet a process, not its nodes, and that takes as long as what then is imported. A hidden
    node makes the middleware begin. A fault of the command line ends the process, as in
    :func:`run_node`, which continues.
    """
    if asks_for_help(sys.argv[1:]):
        return
    if not _initialise(name, sys.argv):
        sys.exit(1)
    _early.append(
        rclpy.create_node(
            "_early",
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
    )


def _initialise(name: str, args: list[str]) -> bool:
    """Whether rclpy accepts the command line; otherwise one line says why not."""
    END_SIGNALS.defer()
    try:
        check_arguments(args[1:])
        for line in remove_half_made(own_domain()):
            print(f"[WARN] [{name}]: {line}", file=sys.stderr, flush=True)
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    # rclpy has no public class for faults of ROS arguments; there is no log yet.
    except (AnnikError, RuntimeError) as error:
        print(f"[FATAL] [{name}]: {one_line(error)}", file=sys.stderr)
        return False
    return True


def run_node(
    name: str,
    make_node: Callable[[], AnyNode],
    parameters: type,
    args: list[str] | None = None,
    *,
    finished: Callable[[AnyNode], Future] | None = None,
    executor: Callable[[AnyNode], Executor] = lambda _: SingleThreadedExecutor(),
    on_error: Callable[[AnyNode, Exception], None] | None = None,
    finish: Callable[[AnyNode], str] | None = None,
) -> int:
    """Run a node until SIGINT, SIGTERM, its own end, or a fault; returns the exit code.

    That is 0, or 1 after one line on the fault.

    Args:
        name: name of the node in the log before it exists.
        make_node: may raise an :class:`AnnikError` for a fault of the set-up.
        parameters: the dataclass of its parameters, for ``--help``.
        args: the command line with the program before it; None: that of the process.
        finished: the future that is done when the node's work is, with the exit code or None.
        executor: makes the executor.
        on_error: receives the error of a callback, after which the node continues; None: it ends.
        finish: what is done at the end in any case; returns a line for the log. May raise an
            :class:`AnnikError`.
    """
    END_SIGNALS.take(name)
    args = sys.argv if args is None else args
    if asks_for_help(args[1:]):
        print(help_text(name, (inspect.getdoc(make_node) or "").partition("\n\n")[0], parameters))
        return 0
    if not _early and not _initialise(name, args):
        return 1
    logger = get_logger(name)
    node: AnyNode | None = None
    exit_code = 1
    try:
        node = make_node()
        while _early:
            _early.pop().destroy_node()
        done = finished(node) if finished else Future()
        spin(node, executor(node), done, partial(on_error, node) if on_error else None)
        exit_code = int(done.result() or 0)
    except ImportError as error:
        logger.fatal(one_line(missing_dependency(error, name)))
    except (AnnikError, NameValidationException) as error:
        logger.fatal(one_line(error))
    finally:
        # Also after an unexpected error.
        last_words = f"ended by {END_SIGNALS.received}" if END_SIGNALS.received else ""
        try:
            if node is not None and finish is not None:
                last_words = finish(node)
        except AnnikError as error:
            logger.fatal(one_line(error))
            last_words, exit_code = "", 1
        if node is not None:
            node.destroy_node()
        if last_words:
            logger.info(last_words)
        rclpy.try_shutdown()
    return exit_code


def spin(
    node: Node,
    executor: Executor,
    finished: Future,
    on_error: Callable[[Exception], None] | None = None,
) -> None:
    """Run callbacks until ``finished`` is done or the process is told to end.

    ``on_error`` receives the error of a callback, after which the node continues; None: it raises.

    Raises:
        AnnikError: from a callback, which ends the process on purpose.
    """
    # Later collections skip what exists now, so that they do not delay targets. What is garbage by
    # now is little, and to collect it first would take a tenth of the start.
    gc.freeze()
    gc.enable()
    try:
        executor.add_node(node)
        # A task ends the present wait.
        END_SIGNALS.call(lambda: executor.create_task(lambda: None))
        while not finished.done() and not END_SIGNALS.received:
            try:
                executor.spin_once(timeout_sec=_LONGEST_WAIT)
            except AnnikError:
                raise
            except Exception as error:
                if on_error is None:
                    raise
                on_error(error)
    finally:
        END_SIGNALS.call(lambda: None)
        executor.shutdown(timeout_sec=0.0)

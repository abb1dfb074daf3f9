"""Targets at a rate, from a process of its own."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.errors import AnnikError

#: Rate of the targets before a stream begins [1/s].
_PRELUDE_RATE = 100.0
#: A sleep may last this much longer; that part of a wait is spent awake [s]. A longer part would
#: take the processor from the nodes.
_OVERSLEPT = 5e-5
#: Linux lengthens sleeps by up to 50 us to save power, unless told otherwise (prctl(2)) [ns].
_PR_SET_TIMERSLACK, _TIMER_SLACK = 29, 1000
_DEPTH = 1000
_END_TIMEOUT = 10.0


@dataclass(frozen=True)
class Stream:
    """What to publish.

    Attributes:
        topic: absolute name.
        rate: [1/s].
        count: how many targets.
        targets: their bytes, repeated if there are fewer.
        prelude: sent until :meth:`TargetStreams.go`; none of ``targets``.
    """

    topic: str
    rate: float
    count: int
    targets: Sequence[bytes]
    prelude: bytes


class StreamFailed(AnnikError):
    """The process that publishes targets has ended."""

    def __init__(self) -> None:
        super().__init__("the process that publishes the targets has ended")


class TargetStreams:
    """Publishes one stream after the other."""

    def __init__(self) -> None:
        """Start the process."""
        # Not forked: the middleware's threads would not come along.
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_publish_all, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def prepare(self, stream: Stream) -> None:
        """Publish the prelude of a stream, until :meth:`go`."""
        self._send(stream)

    def go(self) -> None:
        """Begin the stream itself."""
        self._send(None)

    @property
    def ended(self) -> bool:
        """Whether the stream is over."""
        return self._connection.poll()

    def times(self) -> NDArray[np.int64]:
        """When the targets of the stream were handed over, by the system's clock [ns]; waits.

        Raises:
            StreamFailed: if the process has ended.
        """
        try:
            times: NDArray[np.int64] = self._connection.recv()
        except (EOFError, OSError) as error:
            raise StreamFailed from error
        return times

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        self._process.join(_END_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _send(self, message: Stream | None) -> None:
        try:
            self._connection.send(message)
        except OSError as error:
            raise StreamFailed from error


def _publish_all(connection: Connection[Any, Any]) -> None:
    """Publish every stream that comes, until the other end is closed; runs in the process."""
    # Here: only this process joins the domain as another participant.
    import rclpy
    from geometry_msgs.msg import Pose
    from rclpy.node import Node

    from annik_ros.qos import reliable

    # The parent acts on Ctrl-C: it closes the connection.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _TIMER_SLACK)
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = Node("target_stream")
    try:
        publisher = None
        while True:
            stream = connection.recv()
            # Not before: its last targets may have had to be sent again.
            if publisher is not None:
                node.destroy_publisher(publisher)
            publisher = node.create_publisher(Pose, stream.topic, reliable(_DEPTH))
            while not connection.poll():
                publisher.publish(stream.prelude)
                time.sleep(1.0 / _PRELUDE_RATE)
            connection.recv()
            connection.send(_published(publisher, stream))
    except (EOFError, OSError):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _published(publisher: Any, stream: Stream) -> NDArray[np.int64]:
    """Publish a stream; the times [ns] at which that was begun with each target."""
    times = np.zeros(stream.count, dtype=np.int64)
    period = 1.0 / stream.rate
    number = len(stream.targets)
    deadline = time.perf_counter() + period
    for index in range(stream.count):
        _wait_until(deadline)
        times[index] = time.time_ns()
        publisher.publish(stream.targets[index % number])
        # No catching up: that would be a burst.
        deadline = max(deadline + period, time.perf_counter())
    return times


def _wait_until(deadline: float) -> None:
    left = deadline - time.perf_counter()
    if left > _OVERSLEPT:
        time.sleep(left - _OVERSLEPT)
    while time.perf_counter() < deadline:
        pass

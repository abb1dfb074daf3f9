"""SIGINT and SIGTERM, from the first moment of a node's process to its last.

A thread of their own takes them, so that they interrupt nothing: no import, no start of the
middleware, no end of a recording. Quick to import, to be there early.
"""

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType


class EndSignals:
    """The signals that end this process: in order where there is a node, otherwise at once.

    A signal that was ignored before, as a script's ``ik_node &`` ignores SIGINT, stays ignored.
    """

    def __init__(self) -> None:
        self.received: str | None = None
        self._name = ""
        self._lock = threading.RLock()
        self._is_starting = False
        self._end: Callable[[], None] | None = None

    def take(self, name: str) -> None:
        """Take them from now on, for the node of this name."""
        if self._name:
            return
        self._name = name
        numbers = [
            number
            for number in (signal.SIGINT, signal.SIGTERM)
            if signal.getsignal(number) is not signal.SIG_IGN
        ]
        # Threads inherit what is blocked. The handler is for those that are older.
        signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
        for number in numbers:
            signal.signal(number, self._handle)
        threading.Thread(target=self._wait, args=(numbers,), daemon=True).start()

    def defer(self) -> None:
        """Let the first one wait for :meth:`call`; a second one before that ends the process."""
        with self._lock:
            self._is_starting = True

    def call(self, end: Callable[[], None]) -> None:
        """Call ``end`` from any thread at the first one, now if it came; ignore further ones."""
        with self._lock:
            self._end = end
            if self.received:
                end()

    def _wait(self, numbers: list[signal.Signals]) -> None:
        while numbers:
            self._handle(signal.sigwait(numbers), None)

    def _handle(self, number: int, _: FrameType | None) -> None:
        with self._lock:
            is_first = self.received is None
            self.received = self.received or signal.Signals(number).name
            if self._end is None and not (self._is_starting and is_first):
                line = f"[INFO] [{self._name}]: ended by {self.received} before it was ready\n"
                os.write(2, line.encode())
                # What is half imported or half started can't be ended in order.
                os._exit(0)
            if self._end is not None and is_first:
                self._end()


#: Those of this process.
END_SIGNALS = EndSignals()

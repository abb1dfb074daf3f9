"""The console scripts of the nodes.

Imports next to nothing before the signals are taken, and says in one line what is not installed.
"""

import gc
import signal
import sys
from functools import partial
from importlib import import_module

# They wait until they are taken: amid an import they would be a traceback.
signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))


def run(name: str) -> int:
    """Run a node by its name; returns the exit code."""
    from annik_ros.signals import END_SIGNALS

    END_SIGNALS.take(name)
    # Imports leave hardly any garbage: to look for it would take a tenth of their time. The node
    # enables it again when it spins.
    gc.disable()
    try:
        import_module("annik_ros.run_node").join(name)
        main = import_module(f"annik_ros.{name}.node").main
    except ImportError as error:
        from annik_core.errors import missing_dependency

        problem = missing_dependency(error, name)
        print(f"[FATAL] [{name}]: {problem}", file=sys.stderr)
        return 1
    return int(main())


bag_recorder = partial(run, "bag_recorder")
example_collector = partial(run, "example_collector")
fake_robot = partial(run, "fake_robot")
ik_node = partial(run, "ik_node")
target_publisher = partial(run, "target_publisher")
viewer = partial(run, "viewer")

if __name__ == "__main__":
    sys.exit(run(sys.argv.pop(1)))

"""The page in the browser while its target is dragged: how much of the time it solves, its memory.

A client in a process of its own says what a browser says while a person drags the target, and
counts how often the arm is drawn anew. Nothing is drawn by it: that is the browser's work.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from annik_core.pose import FloatArray
from annik_core.solver.result import IkResult
from annik_view.page import Page
from annik_view.solvers import solver_of
from annik_view.state import ViewState
from benchmarks.command_line import (
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table

#: Targets a second, and how long [min].
_RATE = 30.0
_MINUTES, _QUICK_MINUTES = 20.0, 0.2
#: Memory is compared from then on: until then the trails grow [min].
_SETTLED = 1.0
_PAGE_SIZE = 4096
_MB = 1e6


class _Timed(ViewState):
    """Keeps how long the answers took."""

    solved = 0
    seconds = 0.0

    def move_target(self, pose: Any) -> IkResult:
        """See the class that it derives from."""
        answer = super().move_target(pose)
        self.solved += 1
        self.seconds += self.solve_time
        return answer


@click.command()
@click.option("--robot", default="ur5e", show_default=True, help="Robot or model.")
@click.option("--minutes", type=click.FloatRange(0.05), help=f"How long (default {_MINUTES:g}).")
@quick_option("A shorter time")
@out_option("view_page", "the table")
@docs_option("the table, in results/ there,")
def view_page(
    robot: str, minutes: float | None, quick: bool, out: Path, docs: Path | None
) -> None:
    """Drag a target for minutes: share of the solver, memory."""
    chosen = minutes or (_QUICK_MINUTES if quick else _MINUTES)
    docs = docs_folder(docs, standard=(chosen, robot) == (_MINUTES, "ur5e"), quick=quick)
    folders = output_folders(out, docs)
    state = _Timed(solver_of(robot))
    page = Page(state, port=8600)
    thread = threading.Thread(target=page.run)
    thread.start()
    target = ",".join(map(repr, state.target.tolist()))
    command = (sys.executable, "-m", __name__, page.url, str(60.0 * chosen), target)
    client = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    state.solved, state.seconds, started = 0, 0.0, time.monotonic()
    memory: list[tuple[float, float]] = []
    while client.poll() is None:
        time.sleep(0.5)
        memory.append(((time.monotonic() - started) / 60.0, _memory()))
    elapsed, solved, seconds = time.monotonic() - started, state.solved, state.seconds
    page.close()
    thread.join()
    assert client.stdout is not None
    sent, drawn, dragged = map(float, client.stdout.read().split())
    settled = [used for at, used in memory if at >= min(_SETTLED, 0.5 * chosen)]
    rows = [
        ("time dragged", f"{dragged / 60.0:.1f} min"),
        ("targets sent a second", f"{sent / dragged:.1f}"),
        ("of them solved a second", f"{solved / dragged:.1f}"),
        ("arm drawn anew a second", f"{drawn / dragged:.1f}"),
        ("solve, share of the time", f"{100.0 * seconds / elapsed:.2f} %"),
        ("memory of the process after a minute", f"{settled[0] / _MB:.1f} MB"),
        ("memory at the end", f"{settled[-1] / _MB:.1f} MB"),
        ("most in between", f"{max(settled) / _MB:.1f} MB"),
    ]
    lines = [
        "<!-- Written by ./run bench view_page -->",
        "",
        markdown_table((f"{state.robot.name}, its target dragged", "measured"), rows),
        "",
        machine(),
    ]
    write_table("view_page", lines, folders)


def _memory() -> float:
    """Memory of this process [bytes]."""
    return _PAGE_SIZE * float(Path("/proc/self/statm").read_text("ascii").split()[1])


def drag(url: str, seconds: float, target: FloatArray) -> None:
    """Drag a target around for a time; print targets sent, drawings seen, and the time [s]."""
    import msgspec
    import viser
    import zstandard
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    drawn = 0
    with connect(
        url.replace("http://", "ws://"), subprotocols=[protocol], max_size=None, compression=None
    ) as page:

        def watch() -> None:
            nonlocal drawn
            unpacker = zstandard.ZstdDecompressor()
            for data in page:
                assert isinstance(data, bytes)
                _, size = struct.unpack_from("<QQ", data)
                drawn += b"/arm/links" in unpacker.decompress(data[16 : 16 + size])

        threading.Thread(target=watch, daemon=True).start()
        camera = {
            "type": "ViewerCameraMessage",
            **{"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [2.0, 0.0, 0.0], "fov": 1.0},
            **{"near": 0.1, "far": 100.0, "image_height": 480, "image_width": 640},
            **{"look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0]},
        }
        page.send(msgspec.msgpack.encode(camera))
        time.sleep(1.0)
        started, sent, before = time.monotonic(), 0, drawn
        while (now := time.monotonic() - started) < seconds:
            angle = 2.0 * np.pi * now / 7.0
            x, y, z = target[:3] + 0.08 * np.array([np.cos(angle) - 1.0, np.sin(angle), 0.0])
            qx, qy, qz, qw = target[3:].tolist()
            moved = {
                "type": "TransformControlsUpdateMessage",
                "name": "/target",
                "position": [float(x), float(y), float(z)],
                "wxyz": [qw, qx, qy, qz],
            }
            page.send(msgspec.msgpack.encode(moved))
            sent += 1
            time.sleep(max(0.0, sent / _RATE - (time.monotonic() - started)))
        print(sent, drawn - before, time.monotonic() - started, flush=True)


if __name__ == "__main__":
    drag(sys.argv[1], float(sys.argv[2]), np.array(list(map(float, sys.argv[3].split(",")))))

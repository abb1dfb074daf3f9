"""Sessions of onnxruntime for one pose at a time: without threads, and bound to memory.

For one pose, an encoding in the graph takes long: that of the gantry, some fifty operators on
single numbers, most of the time, that of an arm a quarter. :data:`PLAIN_ENCODINGS` are the same in
plain floats.
"""

import struct
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnxruntime

from annik_core.model.errors import UnreadableModel
from annik_core.pose import ACCURATE_PITCH, FloatArray, roll_pitch_yaw

# Several times faster than an assignment to an array.
_SIX_DOUBLES, _THIRTEEN_DOUBLES = struct.Struct("6d").pack, struct.Struct("13d").pack


def make_session(content: bytes, path: Path) -> onnxruntime.InferenceSession:
    """A session that neither spins nor starts threads; raise UnreadableModel for a bad graph."""
    options = onnxruntime.SessionOptions()
    # For one small network threads only add latency, and spinning ones take a whole core.
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.inter_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(
            content,
            sess_options=options,
            providers=["CPUExecutionProvider"],
            # Otherwise a file that fails is tried again, with a banner on standard output.
            enable_fallback=0,
        )
    # onnxruntime's exceptions have no common base but Exception.
    except Exception as error:
        raise UnreadableModel(path, f"onnxruntime can't load it ({first_line(error)})") from error


class BoundSession:
    """A session bound to memory for one row of inputs and outputs; not for several threads."""

    def __init__(
        self, session: onnxruntime.InferenceSession, names: tuple[str, str], sizes: tuple[int, int]
    ) -> None:
        """Bind input and output, by their names and their numbers in a row."""
        self._input, self._output = (np.zeros((1, size)) for size in sizes)
        #: Input and output themselves.
        self.input_row, self.output_row = self._input[0], self._output[0]
        self._input_bytes = self._input.data.cast("B")
        binding: Any = session.io_binding()
        # Without options onnxruntime makes new ones for every call; without this entry, which is
        # its default, an exception that it catches.
        options = onnxruntime.RunOptions()
        options.add_run_config_entry("gpu_graph_id", "-1")
        # On a processor an OrtValue is the array's own memory.
        binding.bind_ortvalue_input(
            names[0], onnxruntime.OrtValue.ortvalue_from_numpy(self._input)
        )
        binding.bind_ortvalue_output(
            names[1], onnxruntime.OrtValue.ortvalue_from_numpy(self._output)
        )
        # What the methods of onnxruntime's Python call, which take a quarter of a call themselves.
        inner, bound = getattr(session, "_sess", session), getattr(binding, "_iobinding", binding)
        #: Computes the output for what is in the input.
        self.run: Callable[[], None] = partial(inner.run_with_iobinding, bound, options)

    def __call__(self, row: bytes) -> FloatArray:
        """The output ``(m,)`` for an input of ``n`` numbers, given as the bytes of float64."""
        self._input_bytes[:] = row
        self.run()
        output: FloatArray = self.output_row.copy()
        return output


def task_coordinates(pose: FloatArray) -> bytes | None:
    """x, y, z [m], roll, pitch, yaw [rad], as float64; None if the graph is more accurate."""
    x, y, z, *quaternion = pose.tolist()
    roll, pitch, yaw = roll_pitch_yaw(quaternion)
    return _SIX_DOUBLES(x, y, z, roll, pitch, yaw) if abs(pitch) <= ACCURATE_PITCH else None


def position_and_products(pose: FloatArray) -> bytes:
    """x, y, z [m] and the products of the quaternion's numbers, as float64."""
    px, py, pz, x, y, z, w = pose.tolist()
    return _THIRTEEN_DOUBLES(
        *(px, py, pz, x * x, y * y, z * z, w * w),
        *(x * y, x * z, x * w, y * z, y * w, z * w),
    )


class PlainEncoding(NamedTuple):
    """A pose encoding in plain floats.

    Attributes:
        width: how many numbers it has.
        features: of one checked pose ``(7,)``, as bytes of float64; None if the graph is to encode
            this pose.
    """

    width: int
    features: Callable[[FloatArray], bytes | None]


#: By the names of the encodings in model files.
PLAIN_ENCODINGS: Mapping[str, PlainEncoding] = {
    "position_roll_pitch_yaw": PlainEncoding(6, task_coordinates),
    "position_rotation_matrix": PlainEncoding(13, position_and_products),
}


def first_line(error: Exception) -> str:
    """The first line of an exception's message, or its class."""
    return (str(error).splitlines() or [type(error).__name__])[0]

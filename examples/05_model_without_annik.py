"""Use a model file with nothing but onnxruntime: pose in, joint positions out; docs/artifact.md.

Nothing is checked or refined here; annik_core.IkSolver does that.
"""

import json
import sys
from pathlib import Path

import numpy as np
import onnxruntime

packaged = Path(__file__).parents[1] / "models" / "gantry.onnx"
session = onnxruntime.InferenceSession(sys.argv[1] if sys.argv[1:] else packaged)
metadata = session.get_modelmeta().custom_metadata_map

# x, y, z [m] and unit quaternion x, y, z, w; any number of rows.
pose = np.array([[0.35, 0.35, 0.65, 0.0, 0.0, np.sin(0.25), np.cos(0.25)]])
(joint_positions,) = session.run(["joint_positions"], {"pose": pose})

for name, position in zip(
    json.loads(metadata["annik.joint_names"]), joint_positions[0], strict=True
):
    print(f"{name}: {position:.6f} rad")

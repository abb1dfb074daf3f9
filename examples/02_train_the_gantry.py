"""Train the paper's network on the paper's design, and solve a pose with it. Takes seconds."""

import math
import tempfile
from pathlib import Path

from annik_core import IkSolver, load_robot
from annik_training import design_names, generate_dataset, train

robot = load_robot("gantry")
print(f"designs of experiments: {', '.join(design_names())}")

# Six steps in each of the paper's 30 phases: joint positions, and the poses that they give.
dataset = generate_dataset(robot, "thirty_phase", 6, seed=0)
print(f"{len(dataset)} examples")

path = Path(tempfile.mkdtemp()) / "gantry.onnx"
trained = train(dataset, path)
error = trained.evaluation.position_error
print(f"trained in {trained.fitted.seconds:.1f} s: {1e3 * error.p95:.4f} mm at 95 of 100 poses")

solver = IkSolver.from_file(path)
result = solver.solve([0.35, 0.35, 0.65, 0.0, 0.0, math.sin(0.25), math.cos(0.25)])
print([round(math.degrees(position), 3) for position in result.joint_positions], "degrees")
print(f"model file: {path}")

"""Solve targets of ur5e in the compiled kernel of the annik that is installed; not a test itself.

An interpreter of its own runs it, here and in the workflow that builds wheels. It prints where the
kernel is, and fails if the kernel is not what solves, or solves wrongly.
"""

import numpy as np

from annik_core import IkSolver
from annik_core.kernel import compiled_kernel
from annik_core.robots.arm_kinematics import ArmKinematics, CompiledKinematics
from annik_core.robots.screw_chain import ScrewChain

kernel = compiled_kernel()
assert kernel is not None, "the kernel is not compiled"
assert len(kernel.sources) == 64, "the kernel does not say what it was built from"
solver = IkSolver.from_file("ur5e")
robot = solver.robot
assert isinstance(robot.forward_kinematics, CompiledKinematics)
readable = ArmKinematics(robot.joint_names, ScrewChain.from_urdf(robot.definition["urdf"]))
targets = readable.poses(robot.joint_box.sample(200, np.random.default_rng(1)))
for results in ([solver.solve(target) for target in targets], solver.solve_batch(targets)):
    accepted = [result.accepted for result in results]
    assert sum(accepted) > 190, f"{sum(accepted)} of 200 solved"
    found = readable.poses(np.array([r.joint_positions for r in results if r.accepted]))
    assert np.abs(found - targets[accepted]).max() < 1e-5
print(kernel.__file__)

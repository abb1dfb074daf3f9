"""Inverse kinematics by annik and by other solvers on the same targets, for ``./run bench ik``.

What is measured, for one arm and its joint box:

- *Targets*: the poses of random configurations of the box (2000, seed 2026, not a seed of
  training), so each has a solution in the box. All solvers solve one target before the next comes,
  in an order in which each follows each other one equally often. *Success* is 1e-6 m and 1e-6 rad
  by a forward kinematics in NumPy that reads the URDF itself (:mod:`benchmarks.ik.verification`);
  what a solver reports is ignored. *In limits* and *in box*: successes within the robot's limits
  and within the box; the latter is consistency of the branch. Whole turns of a joint are taken off
  first, for all.
- *Time*: from the pose as an array to the joint positions as an array, with the conversion to the
  solver's own types; Python's garbage collection is off. The time of a target is the median of
  three calls, one in each of three rounds over all targets, so that calls that the system
  interrupted do not count. Median, p99 and worst are over the targets, failed ones included.
- *Alone*: single calls, a hundred targets in a row by one solver, so that its code and data are in
  the processor's caches.
- *Straight paths*: 200 lines of 100 points that can be followed within the box without a jump
  (:mod:`benchmarks.ik.straight_paths`). Solvers are not given the previous solution: the question
  is whether their solution is a continuous function of the pose. The largest joint step is
  compared with the largest that the line needs.
- *Throughput*: poses per second for 1, 64 and 4096 poses. annik takes them in one call; the Python
  packages of the others have no such call and run in a loop. Then annik's by its threads.
- *A calibrated robot*: targets of the same arm with a made-up calibration
  (:mod:`benchmarks.ik.calibrated`). The others get the URDF of its geometric part.

Settings, the same for all unless said otherwise:

- The tolerance lets a solver reach 1e-6 m and 1e-6 rad: 5e-7 where it is per component or of the
  norm, and the nearest to that elsewhere. Defaults with which success is impossible here
  (roboticstoolbox, OptIK, KDL's weights) are replaced. A tighter tolerance would only cost time.
- Numerical solvers start at the centre of the box; annik starts at its network's output.
- Solvers that know limits get the box as limits, so that they search on the branch of the targets.
- Closed forms give all solutions; the one in the box nearest to its centre is taken.
- Locked joints are fixed in each solver's model. Models and solvers are made before the timing.
- One thread each, ``OMP_NUM_THREADS=1`` as ``./run bench ik`` sets it; TRAC-IK alone runs its two
  searches in two threads, as it always does.

The settings of each solver, with the reasons, are in its module in :mod:`benchmarks.ik.peers`.
*annik, network* is the network's output with the node's checks but no limit on the residual. It
does not reach 1e-6, and is there to show what the refinement costs. *annik, kernel off* computes
forward kinematics and refinement in NumPy, as where the kernel was not compiled.

A solver that is not installed, or can't do the robot, is skipped and named. One that raises is
counted as failed and named. Solvers with a time limit find less on a loaded machine, so the load
is written down beside the results.

This package needs no torch: the peers have an environment of their own, see ``environment.sh``.
"""

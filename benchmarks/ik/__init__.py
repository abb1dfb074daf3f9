"""Inverse kinematics by annik and by the solvers of others, for ``./run bench ik``.

What is measured, for one arm and its working joint box:

- *Targets*: the poses of random configurations of the box (2000, seed 2026, apart from the seeds
  of training), so each has a solution in the box. Every solver is asked for one at a time, as a
  node would, and all take turns at each target, in an order in which each follows each other one
  equally often. *Success* is 1e-6 m and 1e-6 rad by a forward kinematics in NumPy that reads the
  URDF itself (:mod:`benchmarks.ik.verification`); what a solver says of itself counts for
  nothing. *In limits* and *in box* are successes within the robot's limits and within the box;
  the latter is consistency of the branch. Whole turns of a joint are taken off before, for all.
- *Time*, from the pose as an array to the joint positions as an array, so the conversion to the
  solver's own types is in it, as it is for whoever calls it from Python; Python's garbage
  collection is off meanwhile. All targets are gone through three times, and the median of its
  three calls is the time of a target: a call that the system interrupted says nothing of the
  solver. Median, p99 and worst are over the targets, failed ones included.
- *Alone*: the same, single calls, a hundred targets in a row by one solver before the next has
  its turn: its code and data are then in the processor's caches.
- *Straight paths*: 200 lines of 100 points that can be followed within the box without a jump
  (:mod:`benchmarks.ik.straight_paths`). Solvers are not told the answer before: what is
  asked is whether an answer is a continuous function of the pose. The largest joint step is
  compared with the largest that the line needs.
- *Throughput*: poses per second for 1, 64 and 4096 poses. annik takes them in one call; the
  others, whose Python packages have none for it, in a loop.

Settings that are fair, the same for all unless said otherwise:

- The tolerance lets a solver reach 1e-6 m and 1e-6 rad: 5e-7 where it holds for each component or
  for the norm, and what is nearest to that where it is defined in another way. Default tolerances
  that could never succeed here (roboticstoolbox, OptIK, KDL's weights) are so not held against
  anyone. It is not tighter than needed either, which would cost time.
- Numerical solvers start at the centre of the box: it is what one knows without an answer before.
  annik starts where its network says; that network is what it brings.
- Who knows limits is given the box as limits, so that it searches on the branch that is asked for.
- Closed forms give all solutions; the one in the box nearest to its centre is taken.
- Locked joints are fixed in each solver's model. Models and solvers are made before the timing.
- One thread each, ``OMP_NUM_THREADS=1`` as ``./run bench ik`` sets it; TRAC-IK alone runs its two
  searches in two threads, as it always does.

Solver by solver, with the reasons in their modules in :mod:`benchmarks.ik.peers`:

- annik, network: the network's answer with the node's checks but no limit on the residual. It does
  not reach 1e-6, and is there to show what the refinement costs.
- annik, refined: default options, tolerance 5e-7, up to 10 steps, no random restarts.
- KDL LMA: weights 1, tolerance 1e-7 in the norm, up to 500 iterations, no restarts, no limits.
- TRAC-IK: Speed, 5e-7 for each component, random restarts within 5 ms.
- roboticstoolbox LM: Chan, 5e-7 in the norm; once with one search of 30 iterations and no limits,
  once with up to 100 random searches and the box as limits.
- OptIK: Speed, one thread, 5e-7 in the norm, random restarts within 5 ms.
- Pinocchio CLIK: the loop of its documentation, in Python, with the whole step; 1e-7, up to 100
  iterations, no limits.
- IKPy: scipy's least_squares with its defaults and the box as bounds.
- EAIK and IK-Geo: closed forms; nothing to set.

A solver that is not installed, or can't do the robot, is skipped and named. One that raises is
counted as failed and named. Solvers with a time limit find less on a loaded machine, so the load
is written down beside the results.

This package needs no torch: the peers live in an environment of their own.
"""

"""The benchmark of inverse kinematics, with stand-ins for the solvers. ROS-free."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.processes import run_python

from annik_core.model.artifact import load_model
from annik_core.robots.arm import arm_from_definition
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset
from annik_training.evaluation import evaluation_dataset, network_errors
from annik_training.export import export_model
from annik_training.fitting.fit import fit
from annik_training.fitting.options import FitOptions
from benchmarks.conditions import Conditions
from benchmarks.ik import throughput
from benchmarks.ik.annik import (
    AS_DESCRIBED,
    NETWORK,
    NO_KERNEL,
    REFINED,
    WHOLE_ROBOT,
    our_solvers,
    whole_robot,
)
from benchmarks.ik.command import NoModelForBench, ik
from benchmarks.ik.measure import TargetResult, measure_targets
from benchmarks.ik.measure_alone import AloneResult, measure_alone
from benchmarks.ik.measure_paths import PathResult, measure_paths
from benchmarks.ik.page import bench_page
from benchmarks.ik.peers import library
from benchmarks.ik.peers.closed_form import TURN
from benchmarks.ik.peers.peer import PeerUnavailable
from benchmarks.ik.query import balanced_order, timed_solve
from benchmarks.ik.results import BenchResults, BenchSettings, ModelEntry, SolverEntry
from benchmarks.ik.robot_problem import NotAnArm, robot_problem
from benchmarks.ik.straight_paths import StraightPath, straight_line, straight_paths
from benchmarks.ik.tables import bench_tables
from benchmarks.ik.targets import random_targets
from benchmarks.ik.verification import Verifier
from benchmarks.ik.whole_robot import CALIBRATED, WholeResults
from benchmarks.ik.whole_robot_page import whole_robot_page
from benchmarks.plain_data import built

MICROSECOND = 1000  # [ns]


class StandIn:
    """Answers poses by a table of what leads to them."""

    version = "1.0"
    settings = "none"

    def __init__(self, name="stand-in", known=(), answer=lambda positions: positions, kind=None):
        self.name = name
        self.kind = kind or "numerical"
        self._known = dict(known)
        self._answer = answer
        self.asked = []

    def solve(self, pose):
        self.asked.append(pose.tobytes())
        return self._answer(self._known[pose.tobytes()])


@pytest.fixture(scope="module")
def ur5e() -> Robot:
    return load_robot("ur5e")


@pytest.fixture(scope="module")
def verifier(ur5e) -> Verifier:
    return Verifier(robot_problem(ur5e))


@pytest.fixture(scope="module")
def configurations(ur5e):
    return ur5e.joint_box.sample(12, np.random.default_rng(5))


@pytest.fixture(scope="module")
def poses(ur5e, configurations):
    return ur5e.forward_kinematics.poses(configurations)


@pytest.fixture
def known(configurations, poses):
    return {
        pose.tobytes(): positions for pose, positions in zip(poses, configurations, strict=True)
    }


@pytest.fixture(scope="module")
def model(ur5e, tmp_path_factory) -> Path:
    """Hardly trained at all: it leads the refinement astray now and then, which is all right."""
    dataset = generate_dataset(ur5e, "sobol", 64, 0)
    options = FitOptions(
        hidden_units=(8,),
        optimiser="lbfgs",
        restarts=1,
        held_out_fraction=0.0,
        max_evaluations=20,
        sobolev_weight=1.0,
    )
    fitted = fit(dataset, options)
    path = tmp_path_factory.mktemp("model") / "ur5e.onnx"
    few = evaluation_dataset(ur5e, 20, 0)
    errors = network_errors(fitted.network.joint_positions, few)
    export_model(fitted, errors.summary(), path)
    return path


def measured(solver, poses, verifier, **options) -> TargetResult:
    return measure_targets([solver], poses, poses[:0], verifier, **options)[solver.name]


# --- verification -----------------------------------------------------------------------------


def test_two_forward_kinematics_agree(ur5e, verifier, configurations, poses) -> None:
    distances, angles = verifier.errors(configurations, poses)
    assert max(distances.max(), angles.max()) < 1e-12


def test_errors_are_metres_and_radians(ur5e, verifier, configurations, poses) -> None:
    moved = configurations.copy()
    moved[:, -1] += 0.25  # the last joint turns the tool about its own axis
    distances, angles = verifier.errors(moved, poses)
    assert distances.max() < 1e-12
    assert angles == pytest.approx(0.25)


def test_the_right_answer_counts_everywhere(verifier, poses, known) -> None:
    found = measured(StandIn(known=known), poses, verifier)
    assert (found.answered, found.success, found.in_limits, found.in_box) == (1, 1, 1, 1)


def test_a_wrong_answer_is_no_success_whatever_the_solver_says(verifier, poses, known) -> None:
    found = measured(StandIn(known=known, answer=lambda q: q + 1e-4), poses, verifier)
    assert found.answered == 1.0
    assert (found.success, found.in_limits, found.in_box) == (0, 0, 0)


def test_an_answer_on_another_branch_is_out_of_the_box(ur5e, poses, known) -> None:
    problem = robot_problem(ur5e)
    pan = sorted(float(positions[0]) for positions in known.values())
    middle = 0.5 * (pan[5] + pan[6])
    smaller = replace(problem, box_upper=np.array([middle, *problem.box_upper[1:]]))
    found = measured(StandIn(known=known), poses, Verifier(smaller))
    assert (found.success, found.in_limits, found.in_box) == (1.0, 1.0, 0.5)
    limited = replace(smaller, upper=smaller.box_upper)
    assert measured(StandIn(known=known), poses, Verifier(limited)).in_limits == 0.5


def test_whole_turns_are_the_same_place(verifier, poses, known) -> None:
    found = measured(StandIn(known=known, answer=lambda q: q + 2 * np.pi), poses, verifier)
    assert found.in_box == 1.0


# --- asking -----------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 5, 8, 11])
def test_each_solver_follows_each_other_equally_often(size) -> None:
    orders = [balanced_order(size, turn) for turn in range(2 * size)]
    assert all(sorted(order) == list(range(size)) for order in orders)
    for place in range(size):
        assert sorted(order[place] for order in orders) == sorted(2 * list(range(size)))
    followed = [pair for order in orders for pair in pairwise(order)]
    assert all(followed.count(pair) == 2 for pair in set(followed))
    assert len(set(followed)) == size * (size - 1)


def test_solvers_take_turns_in_changing_order(verifier, poses, known) -> None:
    told = []
    solvers = [
        StandIn(name, known, lambda positions, name=name: told.append(name) or positions)
        for name in "abc"
    ]
    measure_targets(solvers, poses[:6], poses[:0], verifier, rounds=2)
    turns = ["".join(told[begin : begin + 3]) for begin in range(0, len(told), 3)]
    assert all(sorted(turn) == ["a", "b", "c"] for turn in turns)
    assert len(set(turns[:6])) == 6
    # A target has another order in the second round.
    assert all(once != again for once, again in zip(turns[:6], turns[6:], strict=True))


def test_the_warm_up_does_not_count(verifier, poses, known) -> None:
    solver = StandIn(known=known)
    found = measure_targets([solver], poses[2:], poses[:2], verifier, rounds=1)[solver.name]
    assert len(solver.asked) == 12
    assert found.targets == 10


def test_only_the_solver_is_timed(verifier, poses, known) -> None:
    ticks = [0]

    def clock() -> int:
        return ticks[0]

    def work(positions):
        ticks[0] += 7 * MICROSECOND
        return positions

    def other_work(done) -> None:
        ticks[0] += 1000 * MICROSECOND

    found = measured(
        StandIn(known=known, answer=work), poses, verifier, clock=clock, on_target=other_work
    )
    assert (found.median_us, found.p99_us, found.worst_us) == (7.0, 7.0, 7.0)
    assert found.p99_over_median == 1.0


def test_an_interrupted_call_does_not_make_a_target_slow(verifier, poses, known) -> None:
    ticks, calls = [0], count()

    def work(positions):
        ticks[0] += (5000 if next(calls) == 3 else 10) * MICROSECOND
        return positions

    found = measured(
        StandIn(known=known, answer=work), poses, verifier, rounds=3, clock=lambda: ticks[0]
    )
    assert (found.median_us, found.worst_us) == (10.0, 10.0)
    assert found.single_worst_us == 5000.0


class Panic(BaseException):
    """As libraries in Rust raise it."""


@pytest.mark.parametrize("kind", [ValueError, Panic])
def test_a_solver_that_raises_has_failed_and_is_named(verifier, poses, known, kind) -> None:
    calls = count()

    def answer(positions):
        if next(calls) < 3:
            raise kind("out of order\nwith details")
        return positions

    found = measured(StandIn(known=known, answer=answer), poses, verifier, rounds=1)
    assert found.success == pytest.approx(9 / 12)
    assert found.faults == {f"{kind.__name__}: out of order": 3}


def test_ctrl_c_ends_it(poses) -> None:
    def answer(positions):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        timed_solve(StandIn(known={poses[0].tobytes(): None}, answer=answer), poses[0], 6)


@pytest.mark.parametrize("nonsense", [np.full(6, np.nan), np.zeros(5), np.full(6, np.inf)])
def test_nonsense_is_a_fault(verifier, poses, known, nonsense) -> None:
    found = measured(StandIn(known=known, answer=lambda _: nonsense), poses, verifier, rounds=1)
    assert (found.answered, found.success) == (0.0, 0.0)
    assert sum(found.faults.values()) == 12


def test_no_answer_is_a_failure_but_no_fault(verifier, poses, known) -> None:
    found = measured(StandIn(known=known, answer=lambda _: None), poses, verifier)
    assert (found.answered, found.success, found.faults) == (0.0, 0.0, {})


# --- targets and paths ------------------------------------------------------------------------


def test_targets_follow_from_the_seed(ur5e) -> None:
    once, again, other = (
        random_targets(ur5e, 3, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert (once == again).all()
    assert (once != other).any()


@pytest.fixture(scope="module")
def paths(ur5e) -> list[StraightPath]:
    found, tried = straight_paths(ur5e, 3, 20, np.random.default_rng(0))
    assert tried >= 3
    return found


def test_paths_are_straight_and_followed_in_the_box(ur5e, verifier, paths) -> None:
    assert len(paths) == 3
    for path in paths:
        assert path.poses.shape == (20, 7)
        assert verifier.verified(path.joint_positions, path.poses).in_box.all()
        along = path.poses[:, :3] - path.poses[0, :3]
        assert np.abs(np.cross(along, along[-1])).max() < 1e-12
        lengths = np.linalg.norm(np.diff(path.poses[:, :3], axis=0), axis=1)
        assert lengths == pytest.approx(lengths[0])
        assert path.largest_step < 0.5


def test_a_line_turns_the_short_way() -> None:
    begin = np.array([0.0, 0, 0, 0, 0, 0, 1])
    end = np.array([1.0, 0, 0, 0, 0, -np.sin(0.1), -np.cos(0.1)])  # a turn of 0.2 about z
    line = straight_line(begin, end, 3)
    assert line[1] == pytest.approx([0.5, 0, 0, 0, 0, np.sin(0.05), np.cos(0.05)])


def on_paths(paths, verifier, answer=lambda positions: positions) -> PathResult:
    known = {
        pose.tobytes(): positions
        for path in paths
        for pose, positions in zip(path.poses, path.joint_positions, strict=True)
    }
    solver = StandIn(known=known, answer=answer)
    return measure_paths([solver], paths, verifier)[solver.name]


def test_the_reference_itself_has_no_branch_change(paths, verifier) -> None:
    found = on_paths(paths, verifier)
    assert (found.paths, found.solved, found.changing) == (3, 3, 0)
    assert found.largest_ratio == pytest.approx(1.0)
    assert found.largest_step == max(path.largest_step for path in paths)


def flipped(positions):
    """Elsewhere, as on another branch."""
    return positions + np.array([0.0, 0, 0, 0, 0, 1.0])


def test_a_flip_is_a_branch_change(paths, verifier) -> None:
    rows = {row.tobytes() for path in paths[:2] for row in path.joint_positions[10:]}
    found = on_paths(paths, verifier, lambda q: flipped(q) if q.tobytes() in rows else q)
    assert (found.changing, found.solved) == (2, 1)
    assert found.largest_step > 0.9
    assert found.largest_ratio > 1.5


def test_a_flip_in_a_gap_is_found_and_a_gap_alone_is_none(paths, verifier) -> None:
    gap = {row.tobytes() for path in paths for row in path.joint_positions[8:10]}
    after = {row.tobytes() for path in paths for row in path.joint_positions[10:]}

    def answer(positions, flip):
        if positions.tobytes() in gap:
            return None
        return flipped(positions) if flip and positions.tobytes() in after else positions

    assert on_paths(paths, verifier, lambda q: answer(q, True)).changing == 3
    only_gaps = on_paths(paths, verifier, lambda q: answer(q, False))
    assert (only_gaps.changing, only_gaps.solved) == (0, 0)


def test_whole_turns_are_no_step(paths, verifier) -> None:
    turned = {row.tobytes() for path in paths for row in path.joint_positions[::2]}
    found = on_paths(paths, verifier, lambda q: q + 2 * np.pi if q.tobytes() in turned else q)
    assert (found.solved, found.changing) == (3, 0)


def test_who_never_answers_takes_no_steps(paths, verifier) -> None:
    found = on_paths(paths, verifier, lambda _: None)
    assert (found.solved, found.changing, found.largest_step) == (0, 0, 0.0)


# --- throughput -------------------------------------------------------------------------------


class Batches(StandIn):
    def solve_batch(self, poses):
        self.asked.append(len(poses))
        return [None] * len(poses)


def test_batches_are_given_whole_and_others_one_by_one(poses, known) -> None:
    in_batches, one_by_one = Batches("batches"), StandIn("one by one", known)
    rates = throughput.measure_throughput(
        [in_batches, one_by_one], poses, sizes=(1, 4), seconds=1e-4
    )
    assert set(in_batches.asked) == {1, 4}
    assert all(isinstance(asked, bytes) for asked in one_by_one.asked)
    assert all(rate > 0 for of_solver in rates.values() for rate in of_solver.values())


def test_throughput_survives_a_solver_that_raises(poses) -> None:
    rates = throughput.measure_throughput([StandIn()], poses, sizes=(1,), seconds=1e-4)
    assert rates["stand-in"][1] > 0


# --- alone ----------------------------------------------------------------------------------


def test_alone_a_solver_has_its_turn_for_many_targets(poses, known) -> None:
    """Its own time alone is counted."""
    ticks = [0]
    asked = []

    def slow(name, duration):
        def answer(positions):
            asked.append(name)
            ticks[0] += duration
            return positions

        return StandIn(name, known, answer)

    solvers = [slow("a", 1000), slow("b", 3000)]
    found = measure_alone(solvers, poses, 6, clock=lambda: ticks[0])
    assert found["a"].median_us == 1.0
    assert found["b"].p99_us == found["b"].fastest_tenth_us == 3.0
    assert found["b"].p99_over_median == 1.0
    half = len(asked) // 2
    assert asked == ["a"] * half + ["b"] * half
    assert half >= len(poses)


# --- the page ---------------------------------------------------------------------------------


def target_result(success=1.0, **changed) -> TargetResult:
    result = TargetResult(10, 1.0, success, success, success, 20.0, 30.0, 40.0, 30.0, 90.0, {})
    return replace(result, **changed)


def results(**targets: TargetResult) -> BenchResults:
    kinds = {"closed": "closed form", "ours": "ours"}
    return BenchResults(
        robot="ur5e",
        model=ModelEntry("ur5e.onnx", "0123456789abcdef", 512, "sobol", (96, 96), True),
        settings=BenchSettings(targets=10),
        solvers=[SolverEntry(name, "1", kinds.get(name, "numerical"), "") for name in targets],
        skipped=[("TRAC-IK", "not installed (pip install pytracik)")],
        targets=targets,
        alone={name: AloneResult(20.0, 30.0, 15.0) for name in targets},
        paths={name: PathResult(5, 5, 0, 0.1, 1.0) for name in targets},
        lines_tried=9,
        throughput={name: {1: 1000.0, 64: 2000.0} for name in targets},
        threads={1: 1000.0, 2: 1800.0},
        calibrated={name: target_result() for name in (AS_DESCRIBED, REFINED, *targets)},
        conditions=Conditions("a processor", 2, "3.12", {"numpy": "2"}, 0.5, 1.5),
    )


def test_page_names_everything_that_is_needed_to_judge_it() -> None:
    page = bench_page(results(ours=target_result(), theirs=target_result()))
    for expected in (
        "TRAC-IK: not installed (pip install pytracik)",
        "./run bench ik --targets 10",
        "512 examples (sobol)",
        "0123456789ab",
        "a processor",
        "load 0.5 before and 1.5 after",
        "numpy 2",
    ):
        assert expected in page
    assert "Faults" not in page
    faulty = target_result(faults={"ValueError: no": 3})
    assert "theirs: ValueError: no (3 times)" in bench_page(results(theirs=faulty))


def best_of(column: str, found: BenchResults) -> set[str]:
    table = bench_tables(found)[0]
    index = list(table.columns).index(column)
    return {row[0].text for row in table.rows if row[index].best}


def test_the_best_numerical_and_the_best_of_all_stand_out() -> None:
    found = results(
        ours=target_result(median_us=30.0),
        theirs=target_result(median_us=60.0),
        closed=target_result(median_us=10.0),
    )
    assert best_of("median [us]", found) == {"ours", "closed"}
    assert best_of("success [%]", found) == {"ours", "theirs", "closed"}
    slow = replace(found, targets={**found.targets, "closed": target_result(median_us=30.04)})
    assert best_of("median [us]", slow) == {"ours", "closed"}  # to the digits shown
    worse = replace(found, targets={**found.targets, "closed": target_result(median_us=50.0)})
    assert best_of("median [us]", worse) == {"ours"}


def test_quick_but_wrong_is_not_best() -> None:
    found = results(ours=target_result(), theirs=target_result(0.0, median_us=1.0))
    assert best_of("median [us]", found) == {"ours"}
    assert best_of("success [%]", found) == {"ours"}


def test_a_robot_without_paths_has_no_table_of_them() -> None:
    page = bench_page(replace(results(ours=target_result()), paths={}))
    assert "Straight paths" not in page


# --- annik itself, and the command ------------------------------------------------------------


def test_network_and_refined_are_ours(model, ur5e) -> None:
    network, refined = our_solvers(load_model(model))
    assert (network.name, refined.name) == (NETWORK, REFINED)
    pose = random_targets(ur5e, 1, np.random.default_rng(1))[0]
    answer = network.solve(pose)
    # However far it is from the target.
    assert answer is not None
    assert answer == pytest.approx(load_model(model).joint_positions(pose[np.newaxis])[0])


def test_command_writes_page_and_data(model, tmp_path, monkeypatch) -> None:
    def missing(problem):
        raise PeerUnavailable("Other", "not installed")

    class Steady(StandIn):
        name = "Steady"

        def __init__(self, problem):
            super().__init__("Steady")
            self._start = problem.start

        def solve(self, pose, start=None):
            return self._start

    monkeypatch.setattr(library, "PEERS", {"Steady": Steady, "Other": missing})
    monkeypatch.setattr(throughput, "SECONDS", 1e-3)
    monkeypatch.setattr(throughput, "SIZES", (1, 8))
    out, docs = tmp_path / "out", tmp_path / "docs"
    arguments = ["--model", str(model), "--out", str(out), "--docs", str(docs)]
    amounts = ["--targets", "5", "--paths", "2", "--points", "5", "--part", "box"]
    result = CliRunner().invoke(ik, [*arguments, *amounts], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "Steady" in result.output
    assert "skipped Other: not installed" in result.output
    for folder in (out, docs / "results"):
        page = (folder / "ik_bench.md").read_text(encoding="utf-8")
        assert "- Other: not installed" in page
        assert "./run bench ik --model ur5e.onnx --targets 5 --paths 2 --points 5" in page
        data = json.loads((folder / "ik_bench.json").read_text(encoding="utf-8"))
        assert set(data["targets"]) == {NETWORK, REFINED, NO_KERNEL, "Steady"}
        assert set(data["calibrated"]) == {AS_DESCRIBED, REFINED, NO_KERNEL, "Steady"}
        assert data["calibrated"][REFINED]["success"] == 1.0
        assert data["threads"]["1"] > 0
        assert data["settings"]["seed"] == 2026
        assert data["model"]["examples"] == 64
        assert data["skipped"] == [{"name": "Other", "reason": "not installed"}]


def test_whole_robots_are_answered_and_all_solutions_known(tmp_path, monkeypatch) -> None:
    """Beside annik, a solver that lists too few, some of them wrong, and stands still on paths."""

    class Half(StandIn):
        name = "Half"
        kind = "closed form"

        def __init__(self, problem):
            super().__init__("Half")
            arm = {"urdf": problem.urdf, "base_frame": problem.base_frame}
            self._start = problem.start
            self._all = whole_robot(
                arm_from_definition(
                    {**arm, "end_effector_frame": problem.end_effector_frame}, "the arm's"
                )
            ).solutions

        def solve(self, pose, start=None):
            return self._start if start is None else start

        def solutions(self, pose):
            found = self._all(pose)
            return [*found[::2], *(positions + 0.1 for positions in found[1::2]), found[0] + TURN]

    monkeypatch.setattr(library, "PEERS", {"Half": Half})
    monkeypatch.setattr("benchmarks.ik.whole_robot.ARMS", ("panda",))
    options = {"targets": 8, "recall-poses": 4, "restarts": 100, "paths": 2, "points": 5}
    arguments = [f"--{name}={amount}" for name, amount in options.items()]
    command = ["--part", "whole_robot", "--out", str(tmp_path), *arguments]
    result = CliRunner().invoke(ik, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "ik_whole_robot.json").read_text(encoding="utf-8"))
    panda, ur5e = data["arms"]
    assert (panda["name"], ur5e["name"]) == ("panda", CALIBRATED)
    for arm in data["arms"]:
        assert arm["targets"][WHOLE_ROBOT]["in_limits"] == 1.0
        assert arm["targets"]["Half"]["in_limits"] == 0.0
        ours, theirs = (arm["paths"][name] for name in (WHOLE_ROBOT, "Half"))
        assert (ours["solved"], ours["changing"], theirs["solved"]) == (ours["paths"], 0, 0)
    assert panda["every"][WHOLE_ROBOT]["recall"] is None
    of_ur5e = ur5e["every"]
    assert of_ur5e[WHOLE_ROBOT]["recall"] == 1.0
    assert 0.4 <= of_ur5e["Half"]["recall"] < 0.8
    # Of the arm as described, its solutions lead to those of the calibrated one.
    assert of_ur5e["Half as described, then Newton"]["recall"] > of_ur5e["Half"]["recall"]
    page = (tmp_path / "ik_whole_robot.md").read_text(encoding="utf-8")
    assert page == whole_robot_page(built(WholeResults, data))


def test_faults_of_the_command_are_typed(model, tmp_path, monkeypatch) -> None:
    def fault(*arguments: object) -> BaseException:
        command = ["--out", str(tmp_path), *map(str, arguments)]
        return CliRunner().invoke(ik, command).exception

    monkeypatch.setattr("benchmarks.ik.command.share_directory", lambda: tmp_path)
    missing = fault()
    assert isinstance(missing, NoModelForBench)
    assert "annik train --robot ur5e" in str(missing)
    assert isinstance(fault("--robot", "gantry"), NotAnArm)


@pytest.mark.process
def test_it_runs_without_torch() -> None:
    """The peers' environment has none."""
    script = "import sys, benchmarks.ik.command\nsys.exit('torch' in sys.modules)"
    result = run_python("-c", script)
    assert result.returncode == 0, result.stderr

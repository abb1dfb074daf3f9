"""The compiled kernel computes what the readable Python does; Pinocchio agrees with both."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.kernel_fuzz import CONSTRUCTORS, METHODS, fuzz

from annik_core.kernel import compiled_kernel
from annik_core.pose import FloatArray
from annik_core.robots.arm_kinematics import (
    ArmKinematics,
    CompiledKinematics,
    arm_kinematics,
    readable_kinematics,
)
from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    ErrorBound,
    JointHarmonics,
    JointNetworks,
    PoseHarmonics,
    PoseNetwork,
)
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.library import load_robot
from annik_core.robots.robot import ForwardKinematics
from annik_core.robots.screw_chain import ScrewChain
from annik_core.solver.ik_solver import CompiledRefinement
from annik_core.solver.refinement import Refinement
from annik_core.solver.result import RefinementOptions
from annik_core.solver.whole_robot import search_for

pytestmark = pytest.mark.skipif(compiled_kernel() is None, reason="the kernel is not compiled")

ARMS = ("iiwa14", "panda", "puma560", "scara", "ur5e", "xarm6")
CHAINS = 200
#: Between the two ways to compute the same [rad or m].
SAME = 1e-9
#: Where more joints are free than the pose has coordinates, the damping of 1e-12 alone decides
#: what they do beside reaching it, and rounding is magnified.
SAME_OF_REDUNDANT = 1e-6


def motion(rng: np.random.Generator, length: float, angle: float) -> FloatArray:
    turn = Rotation.from_rotvec(rng.normal(size=3) * angle).as_quat(canonical=True)
    return np.concatenate([rng.normal(size=3) * length, turn])


def drawn_chain(rng: np.random.Generator) -> ScrewChain:
    """Three to eight joints, one in five prismatic, anywhere and in any direction."""
    dof = int(rng.integers(3, 9))
    axes = np.zeros((dof, 6))
    for axis in axes:
        direction = rng.normal(size=3)
        part = slice(0, 3) if rng.random() < 0.2 else slice(3, 6)
        axis[part] = direction / np.linalg.norm(direction)
    # Along z both ways, as most robots have it.
    axes[0] = [0, 0, 0, 0, 0, 1]
    axes[1] = [0, 0, 0, 0, 0, -1]
    chain = ScrewChain(np.tile(np.eye(4), (dof + 1, 1, 1)), axes)
    return chain.moved(np.array([motion(rng, 0.3, 1.0) for _ in range(dof + 1)]))


def drawn_corrections(rng: np.random.Generator, dof: int) -> ArmCorrections:
    centre, half_width = rng.normal(size=dof), rng.uniform(0.5, 2.0, dof)
    joints = JointNetworks(
        centre, half_width, *rng.normal(size=(2, dof, 4)), 1e-3 * rng.normal(size=(dof, 4))
    )
    pose = PoseNetwork(
        *(centre, half_width, rng.normal(size=(6, dof)), rng.normal(size=6)),
        1e-3 * rng.normal(size=(6, 6)),
    )
    placements = np.array([motion(rng, 1e-3, 1e-3) for _ in range(dof + 1)])
    parts = [(joints, pose), (joints, None), (None, pose), (None, None)][int(rng.integers(4))]
    waves = rng.integers(-2, 3, (4, dof)).astype(np.float64)
    periodic = PoseHarmonics(waves, *(1e-3 * rng.normal(size=(2, 6, 4))))
    frequencies = rng.choice([1.0, 2.0, 0.4], dof)
    gears = JointHarmonics(frequencies, *(1e-3 * rng.normal(size=(2, dof, 3))))
    gravity = rng.normal(size=3)
    compliances = 1e-3 * rng.normal(size=(dof, dof))
    sag = Deflection(compliances, gravity / np.linalg.norm(gravity))
    used = rng.integers(2, size=3)
    return ArmCorrections(
        placements,
        *parts,
        joint_harmonics=gears if used[0] else None,
        deflection=sag if used[1] else None,
        pose_harmonics=periodic if used[2] else None,
    )


class Both:
    """A drawn chain with its corrections, compiled and in NumPy."""

    def __init__(self, seed: int, corrected: bool) -> None:
        self.rng = np.random.default_rng(seed)
        chain = drawn_chain(self.rng)
        self.dof = len(chain.axes)
        self.names = tuple(f"joint_{number}" for number in range(self.dof))
        corrections = drawn_corrections(self.rng, self.dof) if corrected else None
        turning = [int(np.flatnonzero(chain.axes[:, 3:].any(axis=1))[0])] if corrected else []
        arguments = (self.names, chain, corrections, turning, self.rng.normal(size=self.dof))
        self.compiled = arm_kinematics(*arguments)
        self.readable = readable_kinematics(*arguments)
        assert isinstance(self.compiled, CompiledKinematics)
        lower = self.rng.uniform(-3.0, 0.0, self.dof)
        upper = lower + self.rng.uniform(0.1, 3.0, self.dof)
        if self.dof > 6:
            upper[-1] = lower[-1]  # locked
        self.box = JointLimits(self.names, lower, upper)

    def drawn(self, count: int) -> FloatArray:
        return self.rng.uniform(self.box.lower, self.box.upper, (count, self.dof))


def check_same_kinematics(
    first: ForwardKinematics, second: ForwardKinematics, joint_positions: FloatArray
) -> None:
    poses = first.poses(joint_positions)
    assert poses == pytest.approx(second.poses(joint_positions), abs=1e-12)
    jacobians = first.jacobians(joint_positions)
    assert jacobians == pytest.approx(second.jacobians(joint_positions), abs=1e-12)
    for positions, target in zip(joint_positions, np.roll(poses, 1, axis=0), strict=True):
        found, expected = (way.linearise(positions, target) for way in (first, second))
        assert found.twist == pytest.approx(expected.twist, abs=1e-10)
        assert found.jacobian == pytest.approx(expected.jacobian, abs=1e-12)
        assert found.displacement == pytest.approx(expected.displacement, abs=1e-12)
        assert first.residuals(positions, target) == pytest.approx(found.residuals, rel=1e-12)


def check_same_refinement(
    compiled: ForwardKinematics,
    readable: ForwardKinematics,
    box: JointLimits,
    starts: FloatArray,
    targets: FloatArray,
) -> int:
    """How many converge."""
    assert isinstance(compiled, CompiledKinematics)
    fast = CompiledRefinement(compiled, box)
    slow = Refinement(readable, box)
    results = [fast.refine(*pair) for pair in zip(starts, targets, strict=True)]
    for result, start, target in zip(results, starts, targets, strict=True):
        expected = slow.refine(start, target)
        assert result.converged == expected.converged
        assert result.newton_steps == expected.newton_steps
        if result.converged:
            same = SAME_OF_REDUNDANT if len(box.free) > 6 else SAME
            assert result.joint_positions == pytest.approx(expected.joint_positions, abs=same)
        assert (result.joint_positions >= box.lower).all()
        assert (result.joint_positions <= box.upper).all()
    for threads in (None, 1, 3):
        together = fast.refine_batch(starts, targets, threads)
        for index, result in enumerate(results):
            one = together.row(index)
            assert np.array_equal(one.joint_positions, result.joint_positions)
            assert one[1:] == result[1:]
    return sum(result.converged for result in results)


@pytest.mark.parametrize("corrected", [False, True], ids=["nominal", "corrected"])
def test_drawn_chains(corrected: bool) -> None:
    """Positions, derivatives, and where refinements end, from starts near and far."""
    converged = 0
    for seed in range(CHAINS // 2):
        both = Both(seed, corrected)
        check_same_kinematics(both.compiled, both.readable, 2.0 * both.drawn(3))
        goals = both.drawn(2)
        targets = both.readable.poses(goals)
        near = goals + 0.05 * both.rng.normal(size=goals.shape)
        starts = np.concatenate([near, both.drawn(1)])
        converged += check_same_refinement(
            both.compiled, both.readable, both.box, starts, targets[[0, 1, 0]]
        )
    assert converged > CHAINS


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Iterator[Any]:
    yield load_robot(request.param)


def readable_arm(robot: Any) -> ArmKinematics:
    return ArmKinematics(robot.joint_names, ScrewChain.from_urdf(robot.definition["urdf"]))


def test_packaged_arms(arm: Any) -> None:
    """Inside the box, at its corners, where axes are aligned, and half a turn from the target."""
    rng = np.random.default_rng(2)
    readable, box = readable_arm(arm), arm.joint_box
    inside = rng.uniform(box.lower, box.upper, (20, arm.dof))
    corners = np.where(rng.random((4, arm.dof)) < 0.5, box.lower, box.upper)
    zero = np.clip(np.zeros((1, arm.dof)), box.lower, box.upper)
    goals = np.concatenate([inside, corners, zero])
    check_same_kinematics(arm.forward_kinematics, readable, goals)
    targets = readable.poses(goals)
    half_turn = targets[:5].copy()
    half_turn[:, 3:] = (
        Rotation.from_quat(half_turn[:, 3:]) * Rotation.from_rotvec([np.pi - 1e-7, 0.0, 0.0])
    ).as_quat(canonical=True)
    starts = rng.uniform(box.lower, box.upper, goals.shape)
    for begin, wanted in (
        (starts, targets),
        (goals[:5], half_turn),
        (corners[[0] * 5], targets[:5]),
    ):
        check_same_refinement(arm.forward_kinematics, readable, arm.search_box, begin, wanted)


def test_packaged_arms_are_those_of_pinocchio(arm: Any) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    urdf = arm.definition["urdf"].replace('type="continuous"', 'type="revolute"')
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    frame = model.getFrameId(arm.end_effector_frame, pinocchio.FrameType.BODY)
    joint_positions = arm.joint_box.sample(20, np.random.default_rng(4))
    poses = arm.forward_kinematics.poses(joint_positions)
    jacobians = arm.forward_kinematics.jacobians(joint_positions)
    for positions, pose, jacobian in zip(joint_positions, poses, jacobians, strict=True):
        pinocchio.framesForwardKinematics(model, data, positions)
        placement = data.oMf[frame]
        assert pose[:3] == pytest.approx(placement.translation, abs=1e-12)
        rotation = Rotation.from_quat(pose[3:]).as_matrix()
        assert rotation == pytest.approx(placement.rotation, abs=1e-12)
        axes = pinocchio.LOCAL_WORLD_ALIGNED
        expected = pinocchio.computeFrameJacobian(model, data, positions, frame, axes)
        assert jacobian == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("dof", [1, 6, 7])
def test_error_bounds(dof: int) -> None:
    """Inside their box, outside, and where a joint position is no number."""
    rng = np.random.default_rng(dof)
    centre, half_width = rng.normal(size=dof), rng.uniform(0.5, 2.0, dof)
    bound = ErrorBound(centre, half_width, rng.normal(size=(2, 1 + dof + dof * (dof + 1) // 2)))
    rows = centre + half_width * rng.uniform(-1.5, 1.5, (20, dof))
    found = np.array([bound.at(row) for row in rows])
    assert found == pytest.approx(bound.of_rows(rows), rel=1e-12)
    rows[0, -1] = np.nan
    assert np.isnan(bound.at(rows[0])).all()


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "continuous"])
def test_an_arm_of_one_joint(kind: str) -> None:
    limit = "" if kind == "continuous" else '<limit lower="-0.4" upper="0.5"/>'
    robot = load_robot(
        '<robot name="one"><link name="a"/><link name="b"/><link name="tool"/>'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>'
        f'<origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>{limit}</joint>'
        '<joint name="t" type="fixed"><parent link="b"/><child link="tool"/>'
        '<origin xyz="0 0 0.3"/></joint></robot>'
    )
    readable, goals = readable_arm(robot), np.array([[0.3], [-0.2]])
    check_same_kinematics(robot.forward_kinematics, readable, goals)
    arguments = (robot.search_box, goals[::-1], readable.poses(goals))
    assert check_same_refinement(robot.forward_kinematics, readable, *arguments) == 2


class TestBadInput:
    """Refused or harmless, never undefined."""

    robot = load_robot("ur5e")
    kinematics = robot.forward_kinematics
    at = robot.joint_box.centre
    target = kinematics.poses(at[np.newaxis])[0]

    def refinement(self) -> CompiledRefinement:
        assert isinstance(self.kinematics, CompiledKinematics)
        return CompiledRefinement(self.kinematics, self.robot.search_box)

    @pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
    def test_numbers_that_are_not_finite_take_no_step(self, number: float) -> None:
        for start, target in (
            (np.where(np.arange(6) == 2, number, self.at), self.target),
            (self.at, np.where(np.arange(7) == 1, number, self.target)),
        ):
            result = self.refinement().refine(start, target)
            assert not result.converged or not np.isnan(number)

    @pytest.mark.parametrize("shape", [(), (5,), (7,), (1, 6), (0,)])
    def test_wrong_shapes(self, shape: tuple[int, ...]) -> None:
        assert isinstance(self.kinematics, CompiledKinematics)
        wrong = np.zeros(shape)
        with pytest.raises(ValueError, match="shape"):
            self.kinematics.compiled.linearise(wrong, self.target)
        with pytest.raises(ValueError, match="shape"):
            self.refinement().compiled.refine(wrong, self.target)
        with pytest.raises(ValueError, match="shape"):
            self.refinement().compiled.refine_batch(wrong[np.newaxis], self.target[np.newaxis], 1)

    def test_any_layout_and_type_of_numbers(self) -> None:
        strided = np.zeros((6, 3))
        strided[:, 1] = self.at
        expected = self.kinematics.poses(self.at[np.newaxis])
        not_aligned = np.frombuffer(b"x" + self.at.tobytes(), np.uint8)[1:].view(np.float64)
        for same in (strided[:, 1], self.at.astype(">f8"), not_aligned, self.at.tolist()):
            rows = np.asarray(same)[np.newaxis]
            assert np.array_equal(self.kinematics.poses(rows), expected)
        single = self.at.astype(np.float32)[np.newaxis]
        assert self.kinematics.poses(single) == pytest.approx(expected, abs=1e-6)

    def test_more_than_fits_into_memory(self) -> None:
        assert isinstance(self.kinematics, CompiledKinematics)
        huge = np.broadcast_to(1.0, (2**56, 6))
        with pytest.raises((MemoryError, TypeError, ValueError)):
            self.kinematics.compiled.poses(huge)

    def test_what_is_no_number(self) -> None:
        assert isinstance(self.kinematics, CompiledKinematics)
        for wrong in ("six", None, [object()] * 6):
            with pytest.raises((TypeError, ValueError)):
                self.kinematics.compiled.linearise(wrong, self.target)

    def test_chains_that_are_none(self) -> None:
        kernel = compiled_kernel()
        for placements, axes in (
            (np.eye(4)[np.newaxis], np.zeros((0, 6))),
            (np.zeros((34, 4, 4)), np.zeros((33, 6))),
            (np.zeros((2, 4, 4)), np.zeros((2, 6))),
            (np.zeros((2, 4, 4)), np.zeros(6)),
        ):
            with pytest.raises(ValueError):
                kernel.Chain(placements, axes, None, placements, (), ())
        whole = np.tile(np.eye(4), (2, 1, 1)), np.eye(6)[5:]
        chain = kernel.Chain(*whole, None, whole[0], (), ())
        with pytest.raises(ValueError):
            kernel.Refinement(chain, np.zeros(1), np.zeros(1), 10, 1e-6)  # locked
        for corrections, wrapped, centre in (
            (None, (1,), np.zeros(1)),
            (None, (0,), np.zeros(2)),
            (None, (-1,), np.zeros(1)),
            (self.robot, (), ()),
        ):
            with pytest.raises((AttributeError, TypeError, ValueError)):
                kernel.Chain(*whole, corrections, whole[0], wrapped, centre)

    def test_objects_whose_constructor_was_not_called(self) -> None:
        kernel = compiled_kernel()
        chain = kernel.Chain.__new__(kernel.Chain)
        with pytest.raises(TypeError):
            chain.poses(np.zeros((1, 0)))
        with pytest.raises(TypeError):
            kernel.Refinement(chain, np.zeros(0), np.ones(0), 10, 1e-6)
        with pytest.raises(TypeError):
            kernel.Refinement.__new__(kernel.Refinement).refine(np.zeros(0), self.target)

    def test_error_bounds_that_are_none(self) -> None:
        kernel = compiled_kernel()
        for arguments in (
            (np.zeros(0), np.zeros(0), np.zeros((2, 1))),
            (np.zeros(2), np.ones(3), np.zeros((2, 6))),
            (np.zeros(2), np.ones(2), np.zeros((2, 5))),
        ):
            with pytest.raises(ValueError):
                kernel.ErrorBound(*arguments)
        with pytest.raises(ValueError, match="shape"):
            kernel.ErrorBound(np.zeros(2), np.ones(2), np.zeros((2, 6))).at(np.zeros(3))

    def test_memory_that_is_not_a_networks(self) -> None:
        box, limits = self.robot.search_box, self.robot.joint_limits
        rest = (np.zeros(3), 2.0, limits.lower, limits.upper, 1e-3, 1e-3, 1e-3)
        refinement = self.refinement().compiled
        for input_row, output_row in (
            (np.zeros(12), np.zeros(box.lower.size)),
            (np.zeros(13), np.zeros(box.lower.size + 1)),
            (np.zeros(13, np.float32), np.zeros(box.lower.size)),
            (np.zeros(26)[::2], np.zeros(box.lower.size)),
            (np.frombuffer(bytes(13 * 8)), np.zeros(box.lower.size)),  # read-only
            (np.zeros(13 * 8 + 1, np.uint8)[1:].view("f8"), np.zeros(box.lower.size)),
        ):
            with pytest.raises((TypeError, ValueError)):
                compiled_kernel().BoundSolve(refinement, input_row, output_row, *rest)

    @pytest.mark.parametrize(
        ("inputs", "layers"),
        [
            (0, [(0, None, np.ones((2, 3)), np.ones(2), True)]),
            (3, []),
            (3, [(1, None, np.ones((2, 3)), np.ones(2), True)]),
            (3, [(0, 1, np.ones((2, 3)), np.ones(2), True)]),
            (3, [(0, 0, np.ones((2, 3)), np.ones(2), True)]),
            (3, [(0, None, np.ones((2, 4)), np.ones(2), True)]),
            (3, [(0, None, np.ones((0, 3)), np.ones(0), True)]),
            (3, [(0, None, np.ones((1001, 3)), np.ones(1001), True)]),
        ],
    )
    def test_layers_that_make_no_network(self, inputs: int, layers: list[object]) -> None:
        with pytest.raises(ValueError):
            compiled_kernel().Network(inputs, layers)

    def test_a_network_of_another_robot(self) -> None:
        limits = self.robot.joint_limits
        rest = (np.zeros(3), 2.0, limits.lower, limits.upper, 1e-3, 1e-3, 1e-3)
        memory = np.zeros(13), np.zeros(6)
        bound = compiled_kernel().BoundSolve(self.refinement().compiled, *memory, *rest)
        layer = (0, None, np.ones((5, 13)), np.ones(5), False)
        with pytest.raises(ValueError, match="output"):
            bound.solve(compiled_kernel().Network(13, [layer]), self.target)

    def test_a_search_of_another_robot(self) -> None:
        kernel, limits = compiled_kernel(), self.robot.joint_limits
        rest = (np.zeros(3), 2.0, limits.lower, limits.upper, 1e-3, 1e-3, 1e-3)
        memory = np.zeros(13), np.zeros(6)
        bound = kernel.BoundSolve(self.refinement().compiled, *memory, *rest)
        network = kernel.Network(13, [(0, None, np.ones((6, 13)), np.ones(6), False)])
        other = load_robot("scara")
        search = search_for(other, RefinementOptions()).compiled  # type: ignore[attr-defined]
        with pytest.raises(ValueError, match="robot"):
            bound.find(search, network, False, 10, self.target, None)
        with pytest.raises(ValueError, match="robot"):
            bound.find_all(search, network, False, 10, 0.5, self.target, self.at)

    def test_poses_that_are_none_are_left_to_python(self) -> None:
        memory = np.zeros(13), np.zeros(6)
        limits = self.robot.joint_limits
        rest = (np.zeros(3), 2.0, limits.lower, limits.upper, 1e-3, 1e-3, 1e-3)
        bound = compiled_kernel().BoundSolve(self.refinement().compiled, *memory, *rest)
        for wrong in (None, "pose", [], [0.0] * 6, [[0.0] * 7], ["x"] * 7, object(), {1: 2}):
            assert bound.prepare(wrong) is None
        assert not memory[0].any()
        for same in (self.target, self.target.tolist(), tuple(self.target.tolist())):
            target, reference = bound.prepare(same)
            assert np.array_equal(target, self.target) and reference == ()
        memory[1][:] = np.nan
        assert bound.finish(self.target) is None

    def test_memory_that_is_not_the_gantrys_network(self) -> None:
        six, bounds = np.ones(6), np.array([-np.ones(6), np.ones(6)])
        rest = (1.0, 1.0, 1e-3)
        good = [np.zeros(6), np.zeros(6), six, six, bounds, bounds]
        for place, wrong in (
            (0, np.zeros(5)),
            (1, np.zeros(6, np.float32)),
            (0, np.zeros(12)[::2]),
            (1, np.zeros(6 * 8 + 1, np.uint8)[1:].view("f8")),
            (2, np.ones(5)),
            (4, np.ones(12)),
            (5, np.ones((2, 5))),
        ):
            with pytest.raises((TypeError, ValueError)):
                compiled_kernel().BoundGantry(*good[:place], wrong, *good[place + 1 :], *rest)
        bound = compiled_kernel().BoundGantry(*good, *rest)
        for no_pose in (None, "pose", [0.0] * 6, [np.nan] * 7, [0.0] * 7):
            assert bound.prepare(no_pose) is None
        with pytest.raises(TypeError):
            compiled_kernel().BoundGantry.__new__(compiled_kernel().BoundGantry).prepare(good[0])

    def test_threads_share_it(self) -> None:
        refinement, rng = self.refinement(), np.random.default_rng(6)
        starts = self.robot.joint_box.sample(200, rng)
        expected = [refinement.refine(start, self.target) for start in starts]
        with ThreadPoolExecutor(4) as pool:
            found = list(pool.map(lambda start: refinement.refine(start, self.target), starts))
        for one, other in zip(found, expected, strict=True):
            assert np.array_equal(one.joint_positions, other.joint_positions)


class TestFuzz:
    """In short; ``./run sanitize`` makes a million calls of a kernel with sanitizers."""

    def test_it_calls_every_method_of_every_class(self) -> None:
        kernel = compiled_kernel()
        classes = {name: value for name, value in vars(kernel).items() if isinstance(value, type)}
        assert set(CONSTRUCTORS) == set(METHODS) == set(classes)
        for name, value in classes.items():
            methods = {method for method in vars(value) if not method.startswith("_")}
            assert set(METHODS[name]) == methods

    @pytest.mark.filterwarnings("ignore::numpy.exceptions.ComplexWarning")
    def test_every_call_returns_or_is_refused(self) -> None:
        found = fuzz(compiled_kernel(), calls=9_000, seed=1, threads=2)
        for name, methods in METHODS.items():
            for method in methods:
                assert found.returned[f"{name}.{method}"] > 50
                assert found.refused[f"{name}.{method}"] > 10

"""The command line on arms, most of all on the URDF of one that annik does not know. ROS-free."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result
from support.six_joint_arm import BASE, BOX, FLANGE, FRAMES, JOINT_BOX, JOINTS, URDF

from annik_core.dataset import Dataset
from annik_core.errors import InvalidValue
from annik_core.model.artifact import load_model
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.library import load_robot
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_training.cli import cli, main
from annik_training.cli.options import FIT_NAMES, chosen_dataset, chosen_fit
from annik_training.cli.robot import box_options
from annik_training.cli.train import ConflictingOptions, train
from annik_training.defaults import DEFAULTS, WHOLE_ARM
from annik_training.fitting.options import FitOptions

ARM_FIT = DEFAULTS["arm"].fit


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def words(text: str) -> str:
    """The output without the line breaks and borders of a terminal."""
    return " ".join(re.sub(r"[│┃]", " ", text).split())


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The URDF in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF, encoding="utf-8")
    return Path("arm.urdf")


def test_an_arm_is_trained_from_its_urdf(arm_model: Path) -> None:
    """Frames and box are those given; the summary and the output say what came of it."""
    artifact = load_model(arm_model)
    robot, metadata = artifact.robot, artifact.metadata
    assert (robot.name, robot.kind, robot.joint_names) == ("bench_arm", "arm", JOINTS)
    assert (robot.base_frame, robot.end_effector_frame) == (BASE, FLANGE)
    bounds = np.stack([robot.joint_box.lower, robot.joint_box.upper], axis=1)
    assert np.array_equal(bounds, list(BOX.values()))
    assert "finger" not in robot.definition["urdf"]
    # In the base frame: the stand below it has no part in the pose.
    (pose,) = robot.forward_kinematics.poses(np.zeros((1, 6)))
    assert pose == pytest.approx([0.83, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0], abs=1e-12)
    assert (metadata.design, metadata.examples, metadata.held_out_examples) == ("sobol", 64, 0)
    assert metadata.encoding == "position_rotation_matrix"
    options = replace(ARM_FIT, hidden_units=(8,), max_evaluations=5, seed=3)
    assert metadata.fit_options == options.to_dict()
    summary = json.loads(arm_model.with_name("summary.json").read_text())
    assert (summary["robot"], summary["second_solutions"]) == ("bench_arm", 0)
    assert [restart["evaluations"] for restart in summary["restarts"]] == [5]
    assert summary["evaluation"] == metadata.evaluation
    assert metadata.evaluation["refined"]["success"] > 0.9
    printed = words(arm_model.with_name("printed.txt").read_text())
    assert "64 examples (0 held out to choose among 1 restarts), " in printed
    solved = printed.index(f"{arm_model}: ")
    assert re.match(
        r"[\d.]+ % of random poses solved, [\d.]+ % by", printed[solved:].split(": ")[1]
    )
    assert solved < printed.index("the network alone")


def test_an_arm_without_a_box_is_trained_and_evaluated_as_a_whole(arm: Path) -> None:
    """No word of a box to choose; the file says what is answered and that it is right."""
    trained = invoke(
        *("train", "--robot", arm, *FRAMES, "--evaluation-poses", 300, "--out", "m.onnx")
    )
    assert trained.exit_code == 0, trained.output
    model = load_model(Path("m.onnx"))
    assert IkSolver(model).chosen_mode is SolverMode.WHOLE_ROBOT
    whole = DEFAULTS[WHOLE_ARM]
    assert (model.metadata.design, model.metadata.examples) == (whole.design, whole.size)
    assert model.metadata.fit_options == whole.fit.to_dict()
    assert "refined" not in model.metadata.evaluation
    evaluation = model.metadata.evaluation["whole_robot"]
    assert evaluation["answered"] == evaluation["right"] >= 0.99
    assert 0.0 < evaluation["position_residual_m"] < 1e-6
    assert model.quality.concerns == []
    assert Path("m.onnx").stat().st_size < 3e6
    evaluated = invoke("evaluate", "m.onnx", "--evaluation-poses", 50, "--plot", "map.png")
    assert evaluated.exit_code == 0, evaluated.output
    for output in (trained.output, evaluated.output):
        assert "% of random poses within the joint limits answered" in words(output)
        assert not re.search("ambiguous|redundant|smaller|--joint-box", output)
    assert re.search("first solution: .* us.*all solutions: .*50 poses", words(evaluated.output))


@pytest.mark.slow
def test_evaluate_measures_an_arm_and_draws_a_map(arm_model: Path, tmp_path: Path) -> None:
    plot = tmp_path / "new" / "map.png"
    result = invoke("evaluate", arm_model, "--plot", plot, "--evaluation-poses", 200)
    assert result.exit_code == 0, result.output
    printed = words(result.output)
    assert printed.index("% of random poses solved, ") < printed.index("the network alone")
    assert "200 random poses" in printed
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_info_prints_what_the_model_of_an_arm_says_of_itself(arm_model: Path) -> None:
    result = invoke("info", arm_model)
    assert result.exit_code == 0, result.output
    for entry in (*JOINTS, FLANGE, "optimiser", "lbfgs", "position_rotation_matrix"):
        assert entry in result.output
    assert "<robot" not in result.output


def test_robot_shows_joints_frames_box_and_branches(arm: Path) -> None:
    result = invoke("robot", arm, *FRAMES, *JOINT_BOX)
    assert result.exit_code == 0, result.output
    shown = words(result.output)
    assert "swivel revolute -2.9:2.9 -1:1" in shown
    assert f"frames: {BASE} to {FLANGE}" in shown
    assert "one branch: no singularity" in shown


@pytest.mark.parametrize(
    ("robot", "options", "said"),
    [
        ("arm.urdf", FRAMES, "whole robot: "),
        (
            "arm.urdf",
            (*FRAMES, "--joint-box", "swivel=-1:1"),
            r"two branches or more: [\d.]+ % of the joint box are beyond",
        ),
        ("ur5e", (), r"two branches or more: [345]\.\d % of the joint box are beyond"),
        ("scara", (), "4 joints move: poses in 4 dimensions only"),
        (
            "panda",
            ("--joint-box", "panda_joint3=-1:1"),
            "7 joints move: .* Lock 1 of .* --joint-box panda_joint",
        ),
        ("panda", ("--joint-box", "panda_joint3=0", "--joint-box", "panda_joint3=-1:1"), "Lock 1"),
        ("panda", (), "one branch: no singularity"),
        ("gantry", (), "one branch: every pose of the workspace has one solution"),
    ],
)
def test_robot_says_whether_the_box_is_on_one_branch(
    arm: Path, robot: str, options: tuple[str, ...], said: str
) -> None:
    result = invoke("robot", robot, *options)
    assert result.exit_code == 0, result.output
    assert re.search(said, words(result.output))


def test_a_suggested_box_can_be_pasted(arm: Path) -> None:
    around = ("--around", "shoulder=-0.8", "--around", "elbow=1.1", "--around", "bend=1")
    result = invoke("robot", arm, *FRAMES, "--suggest-box", *around)
    assert result.exit_code == 0, result.output
    pasted = result.output.splitlines()[-1].split()
    boxed = invoke("robot", arm, *FRAMES, *pasted)
    assert boxed.exit_code == 0, boxed.output
    assert "one branch: no singularity" in boxed.output
    for wrong in ("elbow", "elbow=x", "knee=1"):
        refused = invoke("robot", arm, *FRAMES, "--suggest-box", "--around", wrong)
        assert isinstance(refused.exception, InvalidValue)


def test_a_bound_of_zero_has_no_sign() -> None:
    box = JointLimits.from_bounds(["a"], [-1e-4], [0.5])
    assert box_options(box) == "--joint-box a=0:0.5"


@pytest.mark.parametrize("source", ["arm.urdf", "ur5e", "panda", "iiwa14", "scara"])
def test_the_numbers_shown_can_be_typed_back(arm: Path, source: str) -> None:
    """Limits and box, to the last bit; a locked joint is shown as one number."""
    frames = FRAMES if source == "arm.urdf" else ()
    given = (*frames, *(JOINT_BOX if frames else ()))
    shown = invoke("robot", source, *given, "--save", "shown.yaml")
    rows = [line.replace("│", " ").split() for line in shown.output.splitlines()]
    rows = [row for row in rows if len(row) == 4 and row[1] in ("revolute", "prismatic")]
    known = load_robot("shown.yaml")
    assert tuple(row[0] for row in rows) == known.joint_names
    box = [option for row in rows for option in ("--joint-box", f"{row[0]}={row[3]}")]
    assert invoke("robot", source, *frames, *box, "--save", "typed.yaml").exit_code == 0
    assert load_robot("typed.yaml").definition_hash == known.definition_hash
    limits = [option for row in rows for option in ("--joint-box", f"{row[0]}={row[2]}")]
    # Of more than a full turn, the one in their middle.
    assert invoke("robot", source, *frames, *limits).exit_code == 0


def test_a_joint_box_in_degrees_and_millimetres(arm: Path) -> None:
    result = invoke(
        *("robot", "scara", "--joint-box", "joint3=5cm:150mm"),
        *("--joint-box", "joint1=-90deg:90\N{DEGREE SIGN}", "--save", "boxed.yaml"),
    )
    assert result.exit_code == 0, result.output
    box = yaml.safe_load(Path("boxed.yaml").read_text())["joint_box"]
    assert box["joint3"] == pytest.approx([0.05, 0.15])
    assert box["joint1"] == [-np.pi / 2, np.pi / 2]


def test_a_factory_calibration_is_part_of_what_is_saved(tmp_path: Path) -> None:
    origin = "{x: 0.0, y: 0.0, z: 0.163, roll: 0.0, pitch: 0.0, yaw: 0.001}"
    joints = {
        joint.get("name"): joint.find("origin")
        for joint in ElementTree.fromstring(load_robot("ur5e").definition["urdf"]).iter("joint")
    }
    links = {"shoulder": yaml.safe_load(origin)}
    for link, name in (
        ("upper_arm", "shoulder_lift_joint"),
        ("forearm", "elbow_joint"),
        *((f"wrist_{number}", f"wrist_{number}_joint") for number in (1, 2, 3)),
    ):
        numbers = " ".join(joints[name].get(key) for key in ("xyz", "rpy")).split()
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        links[link] = dict(zip(keys, map(float, numbers), strict=True))
    (tmp_path / "factory.yaml").write_text(yaml.safe_dump({"kinematics": links}), "utf-8")
    result = invoke(
        *("robot", "ur5e", "--ur-calibration", tmp_path / "factory.yaml"),
        *("--save", tmp_path / "own.yaml"),
    )
    assert result.exit_code == 0, result.output
    own, usual = load_robot(tmp_path / "own.yaml"), load_robot("ur5e")
    joint_positions = usual.joint_box.sample(5, np.random.default_rng(0))
    here, there = (one.forward_kinematics.poses(joint_positions) for one in (own, usual))
    assert np.allclose(here[:, 2] - there[:, 2], 5e-4)
    assert np.array_equal(own.joint_box.lower, usual.joint_box.lower)


@pytest.mark.parametrize("source", ["arm.urdf", "ur5e", "panda", "gantry"])
def test_a_saved_definition_is_the_same_robot(arm: Path, source: str) -> None:
    """The same hash, so that its models are one another's; and it needs no other file."""
    options = (*FRAMES, *JOINT_BOX) if source == "arm.urdf" else ()
    result = invoke("robot", source, *options, "--save", "saved/robot.yaml")
    assert result.exit_code == 0, result.output
    arm.unlink()
    saved = load_robot(Path("saved/robot.yaml"))
    if source == "arm.urdf":
        known = load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE, joint_box={**BOX})
    else:
        known = load_robot(source)
    assert saved.definition_hash == known.definition_hash
    assert invoke("robot", "saved/robot.yaml", "--save", "again.yaml").exit_code == 0
    assert Path("again.yaml").read_text() == Path("saved/robot.yaml").read_text()
    assert "urdf_file" not in yaml.safe_load(Path("again.yaml").read_text())


def test_a_saved_definition_can_be_given_another_box(arm: Path) -> None:
    """``JOINT=VALUE`` locks; the frames need not be said again, and may be by others."""
    assert invoke("robot", arm, *FRAMES, *JOINT_BOX, "--save", "arm.yaml").exit_code == 0
    result = invoke("robot", "arm.yaml", "--joint-box", "roll=0.25", "--save", "locked.yaml")
    assert result.exit_code == 0, result.output
    assert "5 joints move" in words(result.output)
    box = {**BOX, "roll": (0.25, 0.25)}
    expected = load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE, joint_box=box)
    assert load_robot(Path("locked.yaml")).definition_hash == expected.definition_hash
    short = invoke("robot", "arm.yaml", "--end-effector-frame", "knuckle")
    assert short.exit_code == 0, short.output
    assert "turn" not in short.output


def test_design_checks_and_draws_an_arm(arm: Path) -> None:
    """Sobol unless said otherwise; a dataset is written too."""
    result = invoke(
        *("design", "--robot", arm, *FRAMES, *JOINT_BOX, "--joint-box", "roll=0.5"),
        *("--check", "--plot", "pairs.png", "--out", "d.npz"),
    )
    assert result.exit_code == 0, result.output
    assert "sobol: --examples is 512, the default" in result.output
    assert "sobol: 512 examples for bench_arm" in words(result.output)
    assert Path("pairs.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads(Path("pairs.json").read_text())
    # Constant, 5 joints that move, 5 squares, 10 products.
    assert (numbers["linear"]["rank"], numbers["quadratic"]["rank"]) == (6, 21)
    with np.load("d.npz") as archive:
        assert archive["joint_positions"].shape == (512, 6)
        assert (archive["joint_positions"][:, 3] == 0.5).all()


@pytest.mark.slow
def test_a_dataset_of_an_arm_is_trained_on(arm: Path) -> None:
    """By the defaults of an arm; neither frames nor box can be said beside it."""
    made = invoke(
        *("design", "sobol", "--examples", 16, "--robot", arm, *FRAMES, *JOINT_BOX),
        *("--out", "d.npz"),
    )
    assert made.exit_code == 0, made.output
    result = invoke(
        *("train", "--dataset", "d.npz", "--out", "m.onnx"),
        *("--max-evaluations", 2, "--evaluation-poses", 20),
    )
    assert result.exit_code == 0, result.output
    metadata = load_model(Path("m.onnx")).metadata
    assert (metadata.robot["name"], metadata.examples) == ("bench_arm", 16)
    assert metadata.fit_options == replace(ARM_FIT, max_evaluations=2).to_dict()
    for option in (FRAMES[:2], FRAMES[2:], JOINT_BOX[:2]):
        result = invoke("train", "--dataset", "d.npz", *option, "--out", "other.onnx")
        assert isinstance(result.exception, ConflictingOptions)
        assert result.exception.others == (option[0],)
    assert not Path("other.onnx").exists()


def chosen(*arguments: object) -> tuple[Dataset, FitOptions]:
    """The examples and the options of the fit that arguments of ``annik train`` ask for."""
    choices = train.make_context("train", [*map(str, arguments), "--out", "m.onnx"]).params
    fit_choices = {name: choices.pop(name) for name in FIT_NAMES}
    for name in ("dataset_path", "evaluation_poses", "out", "summary"):
        choices.pop(name)
    seed = choices.pop("seed")
    dataset = chosen_dataset(seed, choices)
    return dataset, chosen_fit(dataset.robot, seed, fit_choices)


@pytest.mark.parametrize(
    ("arguments", "examples", "options"),
    [
        ((), ("gantry", "thirty_phase", 179), FitOptions()),
        (("--robot", "ur5e"), ("ur5e", "sobol", 512), ARM_FIT),
        (
            ("--robot", "ur5e", "--examples", 9, "--restarts", 2, "--no-linear-path"),
            ("ur5e", "sobol", 9),
            replace(ARM_FIT, restarts=2, linear_path=False),
        ),
        (
            ("--robot", "ur5e", "--design", "sobol", "--sobolev", 0),
            ("ur5e", "sobol", 100),
            replace(ARM_FIT, sobolev_weight=0.0),
        ),
        (
            (
                *("--robot", "scara", "--optimiser", "levenberg_marquardt", "--bayesian"),
                *("--held-out", 0.1, "--design", "thirty_phase", "--steps", 2),
            ),
            ("scara", "thirty_phase", 37),
            replace(
                ARM_FIT,
                optimiser="levenberg_marquardt",
                bayesian_regularisation=True,
                held_out_fraction=0.1,
            ),
        ),
        (
            ("--robot", "gantry", "--optimiser", "lbfgs", "--hidden", "6,6"),
            ("gantry", "thirty_phase", 179),
            FitOptions(optimiser="lbfgs", hidden_units=(6, 6)),
        ),
    ],
)
def test_defaults_are_those_of_the_kind_of_robot(
    arguments: tuple[object, ...], examples: tuple[str, str, int], options: FitOptions
) -> None:
    """Design, size and fit; what is said goes before."""
    dataset, fit = chosen(*arguments)
    assert (dataset.robot.name, dataset.design, len(dataset)) == examples
    assert fit == options


#: The arm, spoiled.
_NO_LIMIT = re.sub(r'<limit lower="-2.9" upper="2.9"[^>]*/>', "", URDF, count=1)
_HALF_LIMIT = URDF.replace('<limit lower="-2.9" ', "<limit ", 1)


@pytest.mark.parametrize(
    ("text", "options", "complaint"),
    [
        (_NO_LIMIT, FRAMES, "give its interval by joint_box (--joint-box swivel="),
        (_HALF_LIMIT, FRAMES, "joint 'swivel' is revolute and has no lower limit"),
        (URDF, ("--base-frame", "floor"), "base_frame 'floor' is not a link of the URDF; its"),
        (URDF, ("--end-effector-frame", "tip"), "end_effector_frame 'tip' is not a link"),
        (
            URDF,
            ("--base-frame", BASE, "--end-effector-frame", BASE),
            f"base_frame '{BASE}' is end_effector_frame '{BASE}' too",
        ),
        (URDF, ("--end-effector-frame", "right_finger"), "joint 'follow' mimics joint 'grip'"),
        (URDF, (), "give end_effector_frame, one of its links, such as left_finger ("),
        (URDF, ("--end-effector-frame", BASE), "nothing moves between base_frame"),
        (URDF[:-40], FRAMES, "not XML"),
        ("", FRAMES, "not XML"),
        ("<sdf/>", FRAMES, "its outermost element is <sdf>"),
        (URDF.replace("<robot", "<robot xmlns:xacro='x'><xacro:arg/></robot><robot"), (), "XML"),
        (
            URDF,
            (*FRAMES, "--joint-box", "swivel"),
            "--joint-box is 'swivel'; allowed: JOINT=LOWER:UPPER",
        ),
        (URDF, (*FRAMES, "--joint-box", "swivel="), "joint_box of swivel is ['', ''], not"),
        (URDF, (*FRAMES, "--joint-box", "swivel=a:b"), "joint_box of swivel is ['a', 'b'], not"),
        (URDF, (*FRAMES, "--joint-box", "swivel=0:5mm"), "or in rad, deg"),
        (
            URDF,
            (*FRAMES, "--joint-box", "swivel=0:1:2"),
            "allowed: JOINT=LOWER:UPPER or JOINT=VALUE",
        ),
        (URDF, (*FRAMES, "--joint-box", "=0:1"), "allowed: JOINT=LOWER:UPPER or JOINT=VALUE"),
        (URDF, (*FRAMES, "--joint-box", ""), "allowed: JOINT=LOWER:UPPER or JOINT=VALUE"),
        (URDF, (*FRAMES, "--joint-box", "grip=0:0.01"), "'grip', which is no joint of the chain"),
        (URDF, (*FRAMES, "--joint-box", "swivel=1:0"), "joint_box of swivel is ['1', '0'], not"),
        (URDF, (*FRAMES, "--joint-box", "swivel=-3:3"), "not inside its limits [-2.9, 2.9]"),
        (URDF, (*FRAMES, "--joint-box", "swivel=nan:1"), "not [lower, upper], finite"),
        (URDF, (*FRAMES, "--joint-box", "swivel=0:inf"), "not [lower, upper], finite"),
        (
            URDF,
            (*FRAMES, *(part for joint in JOINTS for part in ("--joint-box", f"{joint}=0"))),
            "locks every joint",
        ),
    ],
)
@pytest.mark.parametrize("command", ["train", "robot"])
def test_a_bad_urdf_or_box_is_one_line_and_exit_code_1(
    arm: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    text: str,
    options: tuple[str, ...],
    complaint: str,
) -> None:
    """Nothing is written, and the file is named where it is at fault."""
    arm.write_text(text, encoding="utf-8")
    arguments = ("train", "--robot", "arm.urdf") if command == "train" else ("robot", "arm.urdf")
    output = "--out" if command == "train" else "--save"
    monkeypatch.setattr(sys, "argv", ["annik", *arguments, *options, output, "made"])
    with pytest.raises(SystemExit) as caught:
        main()
    (line,) = capsys.readouterr().err.splitlines()
    assert caught.value.code == 1
    assert line.startswith("annik: ")
    assert complaint in line
    assert "--joint-box is" in line or "arm.urdf" in line
    assert [path.name for path in Path().iterdir()] == ["arm.urdf"]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("robot", "gantry", "--joint-box", "x_drive_joint=0.4:0.5"), "for an arm only"),
        (("design", "--robot", "gantry", "--base-frame", "base_link"), "for an arm only"),
        (("robot", "none.urdf"), "no robot 'none.urdf'"),
        (("robot", "octopus"), "no robot 'octopus'"),
        (("robot", "ur5e", "--save", "arm.urdf/x.yaml"), "can't be written"),
        (
            ("train", "--robot", "ur5e", "--bayesian", "--out", "m.onnx"),
            "levenberg_marquardt only",
        ),
        (("evaluate", "arm.urdf"), "not an ONNX file"),
        (("info", "arm.urdf"), "not an ONNX file"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_exit_code_1(
    arm: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    complaint: str,
) -> None:
    monkeypatch.setattr(sys, "argv", ["annik", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    (line,) = capsys.readouterr().err.splitlines()
    assert caught.value.code == 1
    assert line.startswith("annik: ")
    assert complaint in line
    assert [path.name for path in Path().iterdir()] == ["arm.urdf"]

"""``annik calibrate`` and ``annik evaluate --measured``, from poses to a model. ROS-free."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from click.testing import CliRunner, Result
from support.imperfect_ur5e import ImperfectUr5e, measured, measured_ur5e

from annik_core.dataset import Dataset, save_dataset
from annik_core.errors import RobotMismatch
from annik_core.model.artifact import load_model
from annik_core.model.errors import InvalidMetadata
from annik_core.robots.calibrated_urdf import geometric_robot
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.safety import IkStatus
from annik_core.solver.ik_solver import IkSolver
from annik_training.calibration.calibrate import CalibrationOptions
from annik_training.calibration.errors import NotHeldOut, NotMeasured
from annik_training.calibration.measurements import Measurements
from annik_training.cli import cli, main
from annik_training.designs.registry import generate_dataset

TRUTH = ImperfectUr5e.drawn(1)
UR5E = load_robot("ur5e")
EXAMPLES = 40


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def words(text: str) -> str:
    """The output without the line breaks and borders of a terminal."""
    return " ".join(re.sub(r"[│┃]", " ", text).split())


@dataclass(frozen=True)
class Made:
    """What the command was given, and what it wrote and printed."""

    measured: Path
    held_out: Path
    model: Path
    summary: dict[str, Any]
    printed: str


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """With an outlier among the examples."""
    folder = tmp_path_factory.mktemp("measured")
    dataset = measured_ur5e(TRUTH, EXAMPLES)
    dataset.poses[11, 1] += 0.01
    save_dataset(dataset, folder / "measured.npz")
    joint_positions = UR5E.joint_box.sample(100, np.random.default_rng(1))
    save_dataset(measured(UR5E, TRUTH.poses, joint_positions, seed=5), folder / "held_out.npz")
    result = invoke(
        *("calibrate", "--measured", folder / "measured.npz", "--examples", 64, "--seed", 2),
        *("--out", folder / "learned.onnx", "--summary", folder / "summary.json"),
        *("--evaluation-poses", 100),
    )
    assert result.exit_code == 0, result.output
    return Made(
        folder / "measured.npz",
        folder / "held_out.npz",
        folder / "learned.onnx",
        json.loads((folder / "summary.json").read_text()),
        words(result.output),
    )


@pytest.mark.slow
class TestCalibrate:
    """The model file that comes of measured poses."""

    def test_carries_the_calibrated_robot(self, made: Made) -> None:
        robot = load_model(made.model).robot
        joint_positions = UR5E.joint_box.sample(300, np.random.default_rng(7))
        away = np.linalg.norm(
            robot.forward_kinematics.poses(joint_positions)[:, :3]
            - TRUTH.poses(joint_positions)[:, :3],
            axis=1,
        )
        assert away.mean() <= 4e-5
        provenance = robot.definition["corrections"]["provenance"]
        assert (provenance["examples"], provenance["outliers"]) == (EXAMPLES, [11])
        assert robot.error_bound is not None

    def test_solves_with_the_calibrated_robot(self, made: Made) -> None:
        """The true robot is where it was told to be, but for what is not known of it."""
        solver = IkSolver(load_model(made.model))
        share = np.random.default_rng(0).uniform(0.2, 0.8, (20, 6))
        box = UR5E.joint_box
        targets = UR5E.forward_kinematics.poses(box.lower + share * (box.upper - box.lower))
        answered = 0
        for target in targets:
            result = solver.solve(target)
            if result.status is not IkStatus.SUCCESS:
                continue
            answered += 1
            (reached,) = TRUTH.poses(result.joint_positions[np.newaxis])
            assert np.linalg.norm(reached[:3] - target[:3]) <= 3e-4
            assert box.contains(result.joint_positions)
        assert answered >= 15

    def test_prints_what_was_calibrated(self, made: Made) -> None:
        assert "40 measured poses of ur5e, 1 outliers left out" in made.printed
        assert "outliers: row 11" in made.printed
        assert "geometry, joint series" in made.printed
        assert made.summary["parts"] == ["geometry", "joint series"]
        assert made.summary["outliers"] == [11]
        assert made.summary["seed"] == 2
        assert made.summary["position_only"] is False
        assert len(made.summary["candidates"]) == 16
        assert "elbow_joint: offset along the axis" in made.summary["unidentified"]

    def test_its_urdf_is_calibrated_or_as_described(self, made: Made, tmp_path: Path) -> None:
        for options, like in (
            (("--calibrated",), geometric_robot(load_model(made.model).robot)),
            ((), UR5E),
        ):
            path = tmp_path / "arm.urdf"
            result = invoke("export-urdf", made.model, "--out", path, *options)
            assert result.exit_code == 0, result.output
            joint_positions = UR5E.joint_box.sample(10, np.random.default_rng(0))
            poses = load_robot(path).forward_kinematics.poses(joint_positions)
            expected = like.forward_kinematics.poses(joint_positions)
            assert np.allclose(poses[:, :3], expected[:, :3], atol=1e-9)

    def test_info_shows_the_model(self, made: Made) -> None:
        result = invoke("info", made.model)
        assert result.exit_code == 0, result.output
        assert "<robot" not in result.output


def test_options_arrive_at_the_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which is not made here."""
    save_dataset(measured_ur5e(TRUTH, 20), tmp_path / "measured.npz")
    asked: list[tuple[str, int, CalibrationOptions]] = []

    def calibrate(robot: Robot, dataset: Dataset, options: CalibrationOptions) -> None:
        asked.append((robot.name, len(dataset), options))
        raise RobotMismatch("enough", "a", "b")

    monkeypatch.setattr("annik_training.calibrate", calibrate)
    arguments = ("--measured", tmp_path / "measured.npz", "--out", tmp_path / "m.onnx")
    for more in (("--position-only", "--seed", 4), ()):
        result = invoke("calibrate", *arguments, *more)
        assert isinstance(result.exception, RobotMismatch)
    assert asked == [
        ("ur5e", 20, CalibrationOptions(position_only=True, seed=4)),
        ("ur5e", 20, CalibrationOptions(position_only=False, seed=0)),
    ]


class TestFiles:
    """What is read of tables and folders arrives at the calibration, which is not made here."""

    @pytest.fixture
    def asked(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Measurements]:
        monkeypatch.chdir(tmp_path)
        asked: list[Measurements] = []

        def calibrate(_: Robot, measurements: Measurements, __: CalibrationOptions) -> None:
            asked.append(measurements)
            raise RobotMismatch("enough", "a", "b")

        monkeypatch.setattr("annik_training.calibrate", calibrate)
        dataset = measured_ur5e(TRUTH, 20)
        table = np.hstack([np.degrees(dataset.joint_positions), 1e3 * dataset.poses[:, :3]])
        header = ",".join([*UR5E.joint_names, "x", "y", "z", "sigma"])
        numbers = np.hstack([table, np.ones((20, 1))])
        for name, rows in (("poses.csv", numbers), ("others.csv", numbers + 1e-6)):
            np.savetxt(name, rows, delimiter=",", header=header, comments="")
        for placement in ("left", "right"):
            Path("sockets", placement).mkdir(parents=True)
            for hole in (0, 1):
                rows = dataset.joint_positions[10 * hole : 10 * hole + 10].copy()
                rows += 1e-3 * (placement == "right")
                np.savetxt(Path("sockets", placement, f"hole_{hole}.csv"), rows, delimiter=",")
        return asked

    def run(self, *arguments: object) -> Result:
        result = invoke("calibrate", "--out", "m.onnx", *arguments)
        assert isinstance(result.exception, RobotMismatch), result.output
        return result

    def test_a_table(self, asked: list[Measurements]) -> None:
        units = ("--length-unit", "mm", "--angle-unit", "deg")
        table = ("--robot", "ur5e", "--measurements", "poses.csv", *units)
        result = self.run(*table)
        self.run(*table, "--measurements", "others.csv", "--frame-known", "--tool-known")
        assert "sigma" in result.output
        expected = measured_ur5e(TRUTH, 20)
        one, two = asked
        assert one.positions is not None
        assert np.allclose(one.positions, expected.poses[:, :3])
        assert np.allclose(one.joint_positions, expected.joint_positions)
        assert (len(one), one.frame_known, one.tool_known) == (20, False, False)
        assert (len(two), two.frame_known, two.tool_known) == (40, True, True)

    def test_sockets(self, asked: list[Measurements]) -> None:
        self.run("--robot", "ur5e", "--sockets", "sockets", "--socket-distance", "0.05")
        self.run("--robot", "ur5e", "--sockets", "sockets/left", "--sockets", "sockets/right")
        one, two = asked
        assert [distance.metres for distance in one.distances] == [0.05, 0.05]
        assert not two.distances
        assert np.array_equal(one.joint_positions, two.joint_positions)

    @pytest.mark.parametrize(
        "arguments",
        [
            ("--out", "m.onnx"),
            ("--out", "m.onnx", "--measurements", "poses.csv"),
            ("--out", "m.onnx", "--robot", "ur5e", "--measurements", "a", "--sockets", "sockets"),
            ("--robot", "ur5e", "--measurements", "poses.csv"),
            ("--out", "m.onnx", "--robot", "ur5e", "--measurements", "a", "--length-unit", "ft"),
        ],
    )
    def test_what_is_missing_or_too_much(
        self, asked: list[Measurements], arguments: tuple[str, ...]
    ) -> None:
        assert invoke("calibrate", *arguments).exit_code == 2
        assert not asked


@pytest.mark.slow
class TestTampering:
    """Corrections in a model file are part of what the robot's hash is about."""

    @pytest.mark.parametrize(
        ("entry", "value", "key"),
        [
            ("placements", [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 7, "robot_hash"),
            ("placements", [[0.0] * 7] * 7, "robot"),
            ("placements", None, "robot"),
            ("joint_harmonics", None, "robot_hash"),
            ("joint_harmonics", {}, "robot"),
            ("error_bound", None, "robot_hash"),
            ("provenance", {"examples": 1000}, "robot_hash"),
            ("more", 1, "robot"),
        ],
    )
    def test_is_refused(
        self, made: Made, tmp_path: Path, entry: str, value: Any, key: str
    ) -> None:
        model = onnx.load(made.model)
        for prop in model.metadata_props:
            if prop.key == "annik.robot":
                definition = json.loads(prop.value)
                definition["corrections"][entry] = value
                prop.value = json.dumps(definition)
        onnx.save(model, tmp_path / "tampered.onnx")
        with pytest.raises(InvalidMetadata) as caught:
            load_model(tmp_path / "tampered.onnx")
        assert caught.value.key == key
        if key == "robot":
            assert f"corrections.{entry}" in str(caught.value)

    def test_nominal_and_calibrated_it_is_one_robot(self, made: Made) -> None:
        """So that a node takes either in place of the other; but none of another arm."""
        learned = load_model(made.model, expected_robot=UR5E).robot
        assert learned.nominal_hash == UR5E.definition_hash != learned.definition_hash
        with pytest.raises(RobotMismatch) as caught:
            load_model(made.model, expected_robot=load_model("panda").robot)
        assert "ur5e" in caught.value.found


@pytest.mark.slow
class TestEvaluate:
    """Before and after."""

    def test_prints_and_writes_both(self, made: Made, tmp_path: Path) -> None:
        summary, plot = tmp_path / "new" / "errors.json", tmp_path / "new" / "errors.png"
        result = invoke(
            *("evaluate", made.model, "--measured", made.held_out),
            *("--summary", summary, "--plot", plot),
        )
        assert result.exit_code == 0, result.output
        shown = words(result.output)
        assert "nominal, position [mm]" in shown
        assert "100 held-out poses" in shown
        assert plot.read_bytes().startswith(b"\x89PNG")
        errors = json.loads(summary.read_text())
        assert errors["poses"] == 100
        assert errors["nominal"]["mean_position_error"] > 2e-3
        assert errors["learned"]["mean_position_error"] < 6e-5
        assert 0.7 <= errors["positions_within_bound"] <= 1.0
        assert len(errors["regions"]) == 18

    def test_summary_is_json_to_any_parser(self, made: Made, tmp_path: Path) -> None:
        """A region without poses has no error; NaN is no JSON."""
        joint_positions = UR5E.joint_box.sample(10, np.random.default_rng(1))
        joint_positions[:, 0] = np.abs(joint_positions[:, 0])
        some = measured(UR5E, TRUTH.poses, joint_positions)
        save_dataset(some, tmp_path / "some.npz")
        result = invoke(
            *("evaluate", made.model, "--measured", tmp_path / "some.npz"),
            *("--summary", tmp_path / "errors.json"),
        )
        assert result.exit_code == 0, result.output
        assert "NaN" not in (tmp_path / "errors.json").read_text()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("calibrate", "--measured", "MEASURED", "--out", "file/m.onnx"), "can't be written"),
        (
            ("calibrate", "--measured", "MEASURED", "--out", "m.onnx", "--summary", "file/s.json"),
            "can't be written",
        ),
        (("calibrate", "--measured", "none.npz", "--out", "m.onnx"), "no such file"),
        (("calibrate", "--measured", "file", "--out", "m.onnx"), "not a dataset"),
        (("calibrate", "--measured", "MODEL", "--out", "m.onnx"), "not a dataset"),
        (
            ("calibrate", "--measured", "MEASURED", "--nominal", "xarm6", "--out", "m.onnx"),
            "the measured dataset belongs to robot ur5e",
        ),
        (
            ("calibrate", "--measured", "MEASURED", "--nominal", "robby", "--out", "m.onnx"),
            "no robot",
        ),
        (
            ("calibrate", "--measured", "MEASURED", "--nominal", "a.urdf", "--out", "m.onnx"),
            "no robot",
        ),
        (
            ("calibrate", "--measured", "FEW", "--out", "m.onnx"),
            "5 measured poses can't determine",
        ),
        (("evaluate", "MODEL", "--measured", "MEASURED"), "calibrated with these 40 poses"),
        (("evaluate", "ur5e", "--measured", "MEASURED"), "for ur5e as described"),
        (("evaluate", "gantry", "--measured", "MEASURED"), "for gantry as described"),
        (("export-urdf", "ur5e", "--calibrated"), "for ur5e as described"),
        (("evaluate", "MODEL", "--measured", "XARM"), "belongs to robot xarm6 (joint1, "),
        (("evaluate", "MODEL", "--measured", "none.npz"), "no such file"),
        (("evaluate", "MODEL", "--summary", "s.json"), "--summary needs --measured"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_exit_code_1(
    made: Made,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    complaint: str,
) -> None:
    """Found out before anything is fitted, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    if "FEW" not in arguments and arguments[0] == "calibrate":
        monkeypatch.setattr("annik_training.calibration.calibrate.find_outliers", None)
    Path("file").write_text("neither a folder nor a dataset", encoding="utf-8")
    files = {"MEASURED": made.measured, "MODEL": made.model, "FEW": "few.npz", "XARM": "xarm.npz"}
    if "FEW" in arguments:
        save_dataset(measured_ur5e(TRUTH, 5), Path("few.npz"))
    if "XARM" in arguments:
        xarm = load_robot("xarm6")
        joint_positions = xarm.joint_box.sample(5, np.random.default_rng(0))
        dataset = measured(xarm, xarm.forward_kinematics.poses, joint_positions)
        save_dataset(dataset, Path("xarm.npz"))
    before = sorted(path.name for path in Path().iterdir())
    given = [str(files.get(argument, argument)) for argument in arguments]
    monkeypatch.setattr(sys, "argv", ["annik", *given])
    with pytest.raises(SystemExit) as caught:
        main()
    (line,) = capsys.readouterr().err.splitlines()
    assert caught.value.code == 1
    assert line.startswith("annik: ")
    assert complaint in line
    assert sorted(path.name for path in Path().iterdir()) == before


@pytest.mark.parametrize(
    ("source", "option"),
    [
        ("--measured", ("--check", "x")),
        ("--measured", ("--length-unit", "m")),
        ("--measured", ("--angle-unit", "deg")),
        ("--measured", ("--frame-known",)),
        ("--measured", ("--tool-known",)),
        ("--measured", ("--socket-distance", "0.05")),
        ("--sockets", ("--frame-known",)),
        ("--sockets", ("--position-only",)),
        ("--measurements", ("--frame-known",)),
        ("--measurements", ("--position-only",)),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(
    source: str, option: tuple[str, ...], tmp_path: Path
) -> None:
    """Of a table, if it has sockets."""
    table, places = tmp_path / "sockets.csv", tmp_path / "places"
    numbers = np.random.default_rng(0).normal(size=(4, 6))
    socketed = np.hstack([numbers, np.ones((4, 1))])
    header = ",".join([*UR5E.joint_names, "socket"])
    np.savetxt(table, socketed, delimiter=",", header=header, comments="")
    (places / "one").mkdir(parents=True)
    for hole in (0, 1):
        np.savetxt(places / "one" / f"hole_{hole}.csv", numbers + hole, delimiter=",")
    path = {"--measured": "none.npz", "--measurements": table, "--sockets": places}[source]
    result = invoke("calibrate", "--robot", "ur5e", source, path, "--out", "m.onnx", *option)
    assert result.exit_code == 2, result.output
    assert option[0] in result.output


@pytest.mark.parametrize(
    "arguments",
    [
        ("--out", "m.onnx", "--base-frame", "base_link"),
        ("--out", "m.onnx", "--end-effector-frame", "tool0"),
        ("--out", "m.onnx", "--joint-box", "elbow_joint=0:1"),
        ("--urdf-out", "u.urdf", "--examples", "100"),
        ("--urdf-out", "u.urdf", "--evaluation-poses", "100"),
    ],
)
def test_an_option_of_what_is_not_given_is_refused(arguments: tuple[str, ...]) -> None:
    result = invoke("calibrate", "--measured", "none.npz", *arguments)
    assert result.exit_code == 2, result.output
    assert arguments[2] in result.output


@pytest.mark.slow
def test_a_table_of_other_rows_checks_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    dataset = measured_ur5e(TRUTH, 60)
    numbers = np.hstack([dataset.joint_positions, dataset.poses])
    header = ",".join([*UR5E.joint_names, "x", "y", "z", "qx", "qy", "qz", "qw"])
    for name, rows in (("poses.csv", numbers[:40]), ("others.csv", numbers[40:])):
        np.savetxt(name, rows, delimiter=",", header=header, comments="")
    asked = ("calibrate", "--robot", "ur5e", "--measurements", "poses.csv", "--urdf-out", "u.urdf")
    result = invoke(*asked, "--check", "others.csv", "--report", "report")
    assert result.exit_code == 0, result.output
    (errors,) = re.findall(r"20 other rows, position error: (\S+) mm", result.output)
    assert float(errors) < 0.1
    assert Path("u.urdf").exists() and Path("report", "report.html").exists()
    assert isinstance(invoke(*asked, "--check", "poses.csv").exception, NotHeldOut)


@pytest.mark.parametrize("command", [("calibrate", "--out", "m.onnx"), ("evaluate", "ur5e")])
def test_a_plan_is_no_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    """Its poses would make a nominal robot one that was measured, and to next to nothing."""
    monkeypatch.chdir(tmp_path)
    save_dataset(generate_dataset(UR5E, "sobol", 20, 0), Path("plan.npz"))
    result = invoke(*command, "--measured", "plan.npz")
    assert isinstance(result.exception, NotMeasured)
    assert "plan.npz were computed, not measured" in str(result.exception)
    assert not Path("m.onnx").exists()

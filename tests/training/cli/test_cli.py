"""The command line: what it prints and writes, and that each fault is one line. ROS-free."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from annik_core.errors import AnnikError
from annik_core.installation import share_directory
from annik_core.model.artifact import default_model_path, load_model
from annik_training.cli.commands import ConflictingOptions, cli, main
from annik_training.designs.registry import DESIGNS
from annik_training.fitting.options import FitOptions

COMMANDS = ("design", "train", "evaluate", "info", "report", "robot")
#: The smallest fit that gives a model file.
TINY = ("--hidden", "3", "--restarts", "1", "--max-evaluations", "1")


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def run_main(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: object
) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of the whole program."""
    monkeypatch.setattr(sys, "argv", ["annik", *map(str, arguments)])
    with pytest.raises(SystemExit) as exit_:
        main()
    output = capsys.readouterr()
    return exit_.value.code or 0, output.out, output.err


def test_help_names_every_command() -> None:
    result = invoke("--help")
    assert result.exit_code == 0
    for command in COMMANDS:
        assert command in result.output
        assert invoke(command, "--help").exit_code == 0
    assert invoke("-h").output == result.output


def test_version() -> None:
    assert invoke("--version").output.startswith("annik, version ")


@pytest.mark.parametrize(
    ("arguments", "count"),
    [
        (("--steps", 3), 102),
        (("--steps", 3, "--paper-rows"), 104),
        (("--steps", 6), 179),
        (("--steps", 6, "--paper-rows"), 194),
        (("thirty_phase", "--steps", 15), 462),
        (("thirty_phase_plus", "--steps", 3), 118),
        (("random", "--examples", 7), 7),
        (("sobol", "--examples", 8), 8),
        (("latin_hypercube", "--examples", 9), 9),
        (("central_composite", "--shells", 2), 153),
        (("workspace_grid", "--positions-per-axis", 3), 108),
        (("workspace_grid", "--positions-per-axis", 4, "--orientation-levels", 2), 448),
    ],
)
def test_design_says_how_many_examples(arguments: tuple[object, ...], count: int) -> None:
    result = invoke("design", *arguments)
    assert result.exit_code == 0, result.output
    assert f": {count} examples for gantry" in " ".join(result.output.split())


@pytest.mark.parametrize("name", sorted(set(DESIGNS) - {"active"}))  # it takes its time
def test_without_a_size_the_default_is_used_and_said(name: str) -> None:
    chosen = DESIGNS[name]
    result = invoke("design", name, "--robot", "ur5e" if chosen.arms_only else "gantry")
    assert result.exit_code == 0, result.output
    assert f"{name}: {chosen.size_flag} is {chosen.default_size}, the default" in result.output


@pytest.mark.parametrize("command", ["design", "train"])
def test_help_names_every_design_and_default_size(command: str) -> None:
    """It does not import them, so as to be quick; it must still say what they say."""
    text = " ".join(invoke(command, "--help").output.split())
    for design in DESIGNS.values():
        assert design.name in text
        assert re.search(
            rf"{design.size_flag} INTEGER [^-]*\(default {design.default_size}\)\.", text
        )


def test_design_checks_and_saves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers here and as JSON, joints by their names, the plot in the current folder."""
    monkeypatch.chdir(tmp_path)
    result = invoke("design", "--steps", 3, "--seed", 4, "--check", "--out", "examples.npz")
    assert result.exit_code == 0, result.output
    assert "quadratic" in result.output
    assert "x_drive_joint*yaw_drive_joint" in result.output
    assert "largest empty ball" in result.output
    assert "wrote thirty_phase_gantry_pairs.png" in result.output
    with np.load("examples.npz") as archive:
        assert archive["poses"].shape == (102, 7)
    assert Path("thirty_phase_gantry_pairs.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads(Path("thirty_phase_gantry_pairs.json").read_text())
    assert (numbers["robot"], numbers["design"], numbers["seed"]) == ("gantry", "thirty_phase", 4)
    assert (numbers["examples"], numbers["design_options"]) == (102, {"size": 3})
    assert (numbers["linear"]["rank"], numbers["quadratic"]["rank"]) == (7, 24)
    assert numbers["quadratic"]["condition"] == pytest.approx(32.37, abs=0.01)
    assert ["x_drive_joint", "yaw_drive_joint"] in numbers["blind_interactions"]


@pytest.fixture
def quick_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare drawing where the picture does not matter."""
    monkeypatch.setattr("annik_training.designs.plot.pair_plot", lambda *_: b"a picture")


@pytest.mark.usefixtures("quick_plot")
def test_a_robot_that_is_no_file_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    packaged = share_directory() / "robots" / "gantry.yaml"
    text = packaged.read_text(encoding="utf-8").replace("name: gantry", "name: ../my robot", 1)
    Path("robot.yaml").write_text(text, encoding="utf-8")
    assert invoke("design", "--robot", "robot.yaml", "--check").exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "robot.yaml",
        "thirty_phase_..-my-robot_pairs.png",
        "thirty_phase_..-my-robot_pairs.json",
    }


@pytest.mark.usefixtures("quick_plot")
def test_where_the_plot_goes_can_be_said(tmp_path: Path) -> None:
    """And asking for it is asking for the check."""
    result = invoke("design", "sobol", "--plot", tmp_path / "new" / "pairs.png")
    assert result.exit_code == 0, result.output
    assert "quadratic" in result.output
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"pairs.png", "pairs.json"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("design", "--steps", 0), "steps is 0"),
        (("design", "random", "--examples", 0), "examples is 0"),
        (("design", "central_composite", "--shells", 0), "shells is 0"),
        (("design", "workspace_grid", "--orientation-levels", 0), "orientation levels is 0"),
        (("design", "sobol", "--steps", 3), "has no option steps; it has examples"),
        (("design", "--plot", "broken.yaml/pairs.png"), "can't be written"),
        (("design", "--plot", "pairs.pdf"), "must end in .png"),
        (("design", "--steps", 3, "--examples", 9), "has no option examples"),
        (("design", "--steps", 3, "--examples", 0), "has no option examples"),
        (("design", "spiral", "--steps", 3), "no design 'spiral'"),
        (("design", "--robot", "octopus", "--steps", 3), "no robot 'octopus'"),
        (("design", "--robot", "broken.yaml", "--steps", 3), "not readable as YAML"),
        (("design", "--steps", 3, "--out", "no/where.npz"), "can't be written"),
        (("train", "--dataset", "none.npz", "--out", "m.onnx"), "no such file"),
        (("train", "--steps", 3, "--restarts", 0, "--out", "m.onnx"), "restarts is 0"),
        (("train", "--steps", 3, "--hidden", "0", "--out", "m.onnx"), "hidden_units is (0,)"),
        (("train", "--held-out", 0.6, "--out", "m.onnx"), "held_out_fraction is 0.6"),
        (("train", "--sobolev", "nan", "--out", "m.onnx"), "slope_weight is nan"),
        (("info", "none.onnx"), "no such file"),
        (("info", "broken.yaml"), "broken.yaml"),
        (("evaluate", "none.onnx"), "no such file"),
        (("report", "none"), "bag none: no such file or folder"),
        (("report", "broken.yaml"), "not a bag folder"),
    ],
)
def test_each_fault_is_one_line_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: tuple[object, ...],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.yaml").write_text("kind: [gantry\nname: {\n")
    code, _, errors = run_main(monkeypatch, capsys, *arguments)
    assert code == 1
    (line,) = errors.splitlines()
    assert line.startswith("annik: ")
    assert complaint in line
    assert [path.name for path in tmp_path.iterdir()] == ["broken.yaml"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("no_such_command",),
        ("design", "--steps", "three"),
        ("design", "sobol", "random"),
        ("design", "--seed", "-1"),
        ("train", "--steps", "3"),
        ("train", "--steps", "3", "--hidden", "many", "--out", "m.onnx"),
    ],
)
def test_wrong_usage_is_exit_code_2(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
) -> None:
    code, _, errors = run_main(monkeypatch, capsys, *arguments)
    assert code == 2
    assert "Error: " in errors


@pytest.mark.parametrize(
    "option",
    [
        ("--robot", "gantry"),
        ("--design", "thirty_phase"),
        ("--steps", "3"),
        ("--examples", "0"),
        ("--shells", "1"),
        ("--paper-rows",),
        ("--positions-per-axis", "2"),
        ("--orientation-levels", "1"),
    ],
)
def test_how_to_make_examples_can_not_be_said_beside_a_dataset(
    tmp_path: Path, option: tuple[str, ...]
) -> None:
    """Also with the value that is the default: what is ignored must not be asked for."""
    result = invoke(
        "train", "--dataset", tmp_path / "d.npz", *option, "--out", tmp_path / "m.onnx"
    )
    assert isinstance(result.exception, ConflictingOptions)
    assert option[0] in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_train_writes_the_model_and_its_summary(tmp_path: Path) -> None:
    dataset, model, summary = (tmp_path / name for name in ("d.npz", "m.onnx", "s.json"))
    assert invoke("design", "--steps", 3, "--out", dataset).exit_code == 0
    result = invoke(
        *("train", "--dataset", dataset, "--seed", 3, *TINY),
        *("--out", model, "--summary", summary),
    )
    assert result.exit_code == 0, result.output
    assert "102 examples" in result.output
    assert "would be refused" in result.stderr
    written = json.loads(summary.read_text())
    assert written["model"] == str(model)
    assert (written["robot"], written["design"], written["seed"]) == ("gantry", "thirty_phase", 3)
    assert (written["examples"], written["held_out_examples"]) == (102, 15)
    assert [restart["number"] for restart in written["restarts"]] == [0]
    assert written["evaluation"]["examples"] == 5000
    assert invoke("info", model).exit_code == 0


def test_an_affine_robot_is_trained_exactly_on_seven_examples(tmp_path: Path) -> None:
    """Nothing held out; the summary is JSON that any parser reads, so without NaN."""
    model, summary = tmp_path / "m.onnx", tmp_path / "s.json"
    result = invoke(
        *("train", "--design", "sobol", "--examples", 7, "--held-out", 0, "--linear-path"),
        *(*TINY, "--out", model, "--summary", summary),
    )
    assert result.exit_code == 0, result.output
    assert "would be refused" not in result.stderr
    assert "0 held out" in result.output

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    written = json.loads(summary.read_text(), parse_constant=refuse)
    assert (written["examples"], written["held_out_examples"]) == (7, 0)
    assert [restart["held_out_error"] for restart in written["restarts"]] == [None]
    assert written["evaluation"]["position_error_m"]["max"] < 1e-6
    assert load_model(model).metadata.fit_options["linear_path"] is True


def test_how_to_fit_can_be_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each flag reaches the option that it names; nothing is trained here."""
    asked = []

    def train(dataset: object, path: Path, options: FitOptions, on_restart: object) -> None:
        asked.append(options)
        raise AnnikError("enough")

    monkeypatch.setattr("annik_training.train.train", train)
    monkeypatch.chdir(tmp_path)
    common = ("train", "--steps", 3, "--out", "m.onnx")
    invoke(*common)
    invoke(*common, "--linear-path", "--sobolev", 0.5, "--bayesian", "--held-out", 0.25)
    invoke(*common, "--hidden", "8,6", "--restarts", 3, "--max-evaluations", 9, "--seed", 4)
    assert asked == [
        FitOptions(),
        FitOptions(
            linear_path=True,
            slope_weight=0.5,
            bayesian_regularisation=True,
            held_out_fraction=0.25,
        ),
        FitOptions(hidden_units=(8, 6), restarts=3, max_evaluations=9, seed=4),
    ]


def test_info_prints_what_a_model_says_of_itself() -> None:
    result = invoke("info", default_model_path())
    assert result.exit_code == 0, result.output
    for entry in ("sha256", "joint_names", "format_version"):
        assert entry in result.output


def test_evaluate_prints_the_errors_of_a_model() -> None:
    result = invoke("evaluate", default_model_path(), "--seed", 2)
    assert result.exit_code == 0, result.output
    assert "position [mm]" in result.output
    assert "5000 random poses" in result.output


@pytest.mark.parametrize("arguments", [("train", "--steps", 3, "--out", "m.onnx")])
def test_a_missing_library_is_named_with_what_installs_it(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[object, ...],
) -> None:
    for name in [name for name in sys.modules if name.startswith("annik_training.")]:
        if name != "annik_training.cli.commands":
            # A module is an attribute of its package too, which importing it again replaces.
            parent, _, child = name.rpartition(".")
            monkeypatch.setattr(sys.modules[parent], child, sys.modules[name])
    for name in [name for name in sys.modules if name.startswith("annik_training.")]:
        if name != "annik_training.cli.commands":
            monkeypatch.delitem(sys.modules, name)
    # None in sys.modules is how Python is told that a module can't be imported.
    monkeypatch.setitem(sys.modules, "torch", None)
    code, _, errors = run_main(monkeypatch, capsys, *arguments)
    assert code == 1
    assert errors == "annik: this needs torch: install it with pip install '.[training]'\n"


def test_only_known_libraries_are_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any other failing import is a fault of annik, and keeps its traceback."""

    def fail() -> None:
        raise ModuleNotFoundError("No module named 'nothing'", name="nothing")

    monkeypatch.setattr("annik_training.cli.commands.cli", lambda **_: fail())
    with pytest.raises(ModuleNotFoundError) as caught:
        main()
    assert not isinstance(caught.value, AnnikError)

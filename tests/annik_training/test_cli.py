"""The command line: what it prints and writes, and that each fault is one line. ROS-free."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from annik_core.artifact import default_model_path
from annik_core.errors import AnnikError, DesignError
from annik_training.cli import ConflictingOptions, cli, main

COMMANDS = ("design", "train", "evaluate", "info", "report")
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
        (("--design", "thirty_phase_plus", "--steps", 3), 118),
        (("--design", "random", "--examples", 7), 7),
        (("--design", "sobol", "--examples", 8), 8),
        (("--design", "latin_hypercube", "--examples", 9), 9),
        (("--design", "workspace_grid", "--positions-per-axis", 3), 108),
        (
            ("--design", "workspace_grid", "--positions-per-axis", 4, "--orientation-levels", 2),
            448,
        ),
    ],
)
def test_design_says_how_many_examples(arguments: tuple[object, ...], count: int) -> None:
    result = invoke("design", *arguments)
    assert result.exit_code == 0, result.output
    assert f": {count} examples for gantry" in " ".join(result.output.split())


def test_design_checks_and_saves(tmp_path: Path) -> None:
    out = tmp_path / "examples.npz"
    result = invoke("design", "--steps", 3, "--seed", 4, "--check", "--out", out)
    assert result.exit_code == 0, result.output
    assert "quadratic" in result.output
    assert "largest empty ball" in result.output
    with np.load(out) as archive:
        assert archive["poses"].shape == (102, 7)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("design",), "design thirty_phase needs --steps"),
        (("design", "--design", "random"), "design random needs --examples"),
        (("design", "--design", "workspace_grid"), "needs --positions-per-axis"),
        (("design", "--steps", 0), "steps is 0"),
        (("design", "--design", "random", "--examples", 0), "examples is 0"),
        (
            (
                *("design", "--design", "workspace_grid"),
                *("--positions-per-axis", 2, "--orientation-levels", 0),
            ),
            "orientation levels is 0",
        ),
        (("design", "--steps", 3, "--examples", 9), "has no option examples"),
        (("design", "--steps", 3, "--examples", 0), "has no option examples"),
        (("design", "--design", "spiral", "--steps", 3), "no design 'spiral'"),
        (("design", "--robot", "octopus", "--steps", 3), "no robot 'octopus'"),
        (("design", "--robot", "broken.yaml", "--steps", 3), "not readable as YAML"),
        (("design", "--steps", 3, "--out", "no/where.npz"), "can't be written"),
        (("train", "--dataset", "none.npz", "--out", "m.onnx"), "no such file"),
        (("train", "--steps", 3, "--restarts", 0, "--out", "m.onnx"), "restarts is 0"),
        (("train", "--steps", 3, "--hidden", "0", "--out", "m.onnx"), "hidden_units is (0,)"),
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


def test_a_size_that_is_not_given_and_one_of_zero_are_different_faults() -> None:
    missing, zero = invoke("design").exception, invoke("design", "--steps", 0).exception
    assert isinstance(missing, DesignError)
    assert isinstance(zero, DesignError)
    assert str(missing) != str(zero)


@pytest.mark.parametrize(
    "option",
    [
        ("--robot", "gantry"),
        ("--design", "thirty_phase"),
        ("--steps", "3"),
        ("--examples", "0"),
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
    written = json.loads(summary.read_text())
    assert written["model"] == str(model)
    assert (written["robot"], written["design"], written["seed"]) == ("gantry", "thirty_phase", 3)
    assert (written["examples"], written["held_out_examples"]) == (102, 15)
    assert [restart["number"] for restart in written["restarts"]] == [0]
    assert written["evaluation"]["examples"] == 5000
    assert invoke("info", model).exit_code == 0


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
        if name != "annik_training.cli":
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

    monkeypatch.setattr("annik_training.cli.cli", lambda **_: fail())
    with pytest.raises(ModuleNotFoundError) as caught:
        main()
    assert not isinstance(caught.value, AnnikError)

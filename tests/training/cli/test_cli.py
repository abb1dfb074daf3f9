"""The command line: what it prints and writes, and that each fault is one line. ROS-free."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.processes import run_python

from annik_core.errors import AnnikError
from annik_core.installation import default_model_path, share_directory
from annik_core.model.artifact import load_model
from annik_core.robots.library import load_robot
from annik_core.settings import settings_of
from annik_training import cli as cli_package
from annik_training.cli import COMMANDS, cli, main
from annik_training.cli.options import FIT_NAMES, chosen_fit
from annik_training.cli.train import ConflictingOptions, train
from annik_training.defaults import DEFAULTS
from annik_training.designs.registry import DESIGNS, Needs
from annik_training.fitting.options import FitOptions

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


def test_help_names_every_command_and_says_what_it_does() -> None:
    """The list of commands loads none of them, so it has their first sentences itself."""
    result = invoke("--help")
    assert result.exit_code == 0
    assert invoke("-h").output == result.output
    shared = {"__init__", "__main__", "calibration_report", "options", "output", "plots"}
    files = {path.stem for path in Path(str(cli_package.__file__)).parent.glob("*.py")}
    assert set(COMMANDS) == files - shared - {"model_files"} | {"info", "export-urdf"}
    shown = " ".join(result.output.split())
    for command, sentence in COMMANDS.items():
        assert f"{command} {sentence}" in shown
        helped = invoke(command, "--help")
        assert helped.exit_code == 0
        assert sentence in " ".join(helped.output.split())


@pytest.mark.process
@pytest.mark.parametrize(
    ("arguments", "forbidden"),
    [
        (["--help"], {"numpy", "onnxruntime", "scipy", "torch"}),
        (["report", "--help"], {"onnxruntime", "torch"}),
        (["train", "--help"], {"matplotlib", "onnxruntime", "scipy", "torch"}),
        (["design", "--help"], {"matplotlib", "onnxruntime", "sympy", "torch"}),
        (["evaluate", "--help"], {"matplotlib", "torch"}),
        (["info", "--help"], {"scipy", "torch"}),
    ],
)
def test_help_and_report_load_nothing_heavy(arguments: list[str], forbidden: set[str]) -> None:
    """``annik report`` works where torch is not installed, and ``--help`` is quick."""
    script = (
        "import sys\n"
        "from annik_training.cli import cli\n"
        f"cli({arguments!r}, standalone_mode=False)\n"
        f"print(sorted({forbidden!r} & set(sys.modules)))\n"
    )
    result = run_python("-c", script)
    assert result.stdout.endswith("[]\n"), result.stdout + result.stderr


def test_the_new_name_of_a_command_is_suggested() -> None:
    result = invoke("fit", "--measured", "m.npz")
    assert result.exit_code == 2
    assert "No such command 'fit'. Did you mean 'calibrate'?" in result.output


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
    result = invoke("design", name, "--robot", "ur5e" if chosen.needs is Needs.ARM else "gantry")
    assert result.exit_code == 0, result.output
    assert f"{name}: {chosen.size.flag} is {chosen.size.default}, the default" in result.output


@pytest.mark.parametrize("command", ["design", "train"])
def test_help_names_every_design_and_default_size(command: str) -> None:
    text = " ".join(invoke(command, "--help").output.split())
    for design in DESIGNS.values():
        size = design.size
        assert re.search(
            rf"{size.flag} INTEGER [^-]*{design.name}[^-]*\(default {size.default}\)\.", text
        )


def test_help_names_every_option_of_a_fit_and_its_defaults() -> None:
    text = " ".join(invoke("train", "--help").output.split())
    for option in settings_of(FitOptions):
        assert (option.description in text) == (option.name in FIT_NAMES)
    fits = [usual.fit.restarts for usual in DEFAULTS.values()]
    assert "Default: gantry: {}; arm: {}; whole arm: {}.".format(*fits) in text
    assert "Default: gantry: 20; arm: 48,48; whole arm: 24." in text


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


def test_where_the_plot_goes_can_be_said(tmp_path: Path) -> None:
    """And asking for it is asking for the check."""
    result = invoke("design", "sobol", "--plot", tmp_path / "new" / "pairs.png")
    assert result.exit_code == 0, result.output
    assert "quadratic" in result.output
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"pairs.png", "pairs.json"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("design", "--steps", 0), "steps of design thirty_phase is 0"),
        (("design", "random", "--examples", 0), "examples of design random is 0"),
        (
            ("design", "central_composite", "--shells", 0),
            "shells of design central_composite is 0",
        ),
        (
            ("design", "workspace_grid", "--orientation-levels", 0),
            "orientation_levels of design workspace_grid is 0",
        ),
        (
            ("design", "sobol", "--steps", 3),
            "option of design sobol is 'steps'; allowed: examples",
        ),
        (("design", "--plot", "broken.yaml/pairs.png"), "can't be written"),
        (("design", "--plot", "pairs.pdf"), "ends in .png"),
        (
            ("design", "--steps", 3, "--examples", 9),
            "option of design thirty_phase is 'examples'; allowed: steps",
        ),
        (
            ("design", "--steps", 3, "--examples", 0),
            "option of design thirty_phase is 'examples'; allowed: steps",
        ),
        (("design", "spiral", "--steps", 3), "design is 'spiral'; allowed: thirty_phase, "),
        (("design", "--robot", "octopus", "--steps", 3), "no robot 'octopus'"),
        (("design", "--robot", "broken.yaml", "--steps", 3), "nor readable as YAML"),
        (("design", "--steps", 3, "--out", "no/where.npz"), "can't be written"),
        (("train", "--dataset", "none.npz", "--out", "m.onnx"), "no such file"),
        (("train", "--steps", 3, "--restarts", 0, "--out", "m.onnx"), "restarts is 0"),
        (("train", "--steps", 3, "--hidden", "0", "--out", "m.onnx"), "hidden_units is (0,)"),
        (("train", "--held-out", 0.6, "--out", "m.onnx"), "held_out_fraction is 0.6"),
        (("train", "--sobolev", "nan", "--out", "m.onnx"), "sobolev_weight is nan"),
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


@pytest.mark.slow
def test_train_writes_the_model_and_its_summary(tmp_path: Path) -> None:
    dataset, model, summary = (tmp_path / name for name in ("d.npz", "m.onnx", "s.json"))
    assert invoke("design", "--steps", 3, "--out", dataset).exit_code == 0
    result = invoke(
        *("train", "--dataset", dataset, "--seed", 3, *TINY),
        *("--out", model, "--summary", summary),
    )
    assert result.exit_code == 0, result.output
    assert "102 examples" in result.output
    assert "annik: poor: " in result.stderr
    written = json.loads(summary.read_text())
    assert written["model"] == str(model)
    assert (written["robot"], written["design"], written["seed"]) == ("gantry", "thirty_phase", 3)
    assert (written["examples"], written["held_out_examples"]) == (102, 15)
    assert [restart["number"] for restart in written["restarts"]] == [0]
    assert written["evaluation"]["examples"] == 5000
    assert invoke("info", model).exit_code == 0


@pytest.mark.slow
def test_an_affine_robot_is_trained_exactly_on_seven_examples(tmp_path: Path) -> None:
    """Nothing held out; the summary is JSON that any parser reads, so without NaN."""
    model, summary = tmp_path / "m.onnx", tmp_path / "s.json"
    result = invoke(
        *("train", "--design", "sobol", "--examples", 7, "--held-out", 0, "--linear-path"),
        *(*TINY, "--out", model, "--summary", summary),
    )
    assert result.exit_code == 0, result.output
    assert "poor" not in result.stderr
    assert "100 % of random poses solved" in result.output
    assert "0 held out" in result.output

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    written = json.loads(summary.read_text(), parse_constant=refuse)
    assert (written["examples"], written["held_out_examples"]) == (7, 0)
    assert [restart["held_out_error"] for restart in written["restarts"]] == [None]
    assert written["evaluation"]["position_error_m"]["max"] < 1e-6
    assert load_model(model).metadata.fit_options["linear_path"] is True


def fit_options(*arguments: object) -> FitOptions:
    """The options of the fit that arguments of ``annik train`` ask for."""
    context = train.make_context("train", [*map(str, arguments), "--out", "m.onnx"])
    choices = {name: context.params[name] for name in FIT_NAMES}
    return chosen_fit(load_robot(context.params["robot"]), context.params["seed"], choices)


def test_how_to_fit_can_be_said() -> None:
    """Each flag reaches the option that it names."""
    assert fit_options() == FitOptions()
    assert fit_options(
        "--linear-path", "--sobolev", 0.5, "--bayesian", "--held-out", 0.25
    ) == FitOptions(
        linear_path=True, sobolev_weight=0.5, bayesian_regularisation=True, held_out_fraction=0.25
    )
    assert fit_options(
        "--hidden", "8,6", "--restarts", 3, "--max-evaluations", 9, "--seed", 4
    ) == FitOptions(hidden_units=(8, 6), restarts=3, max_evaluations=9, seed=4)


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


@pytest.mark.process
@pytest.mark.parametrize(
    ("library", "command", "remedy"),
    [
        ("torch", ["train", "--steps", "3", "--out", "m.onnx"], "pip install 'annik_ros[train]'"),
        ("rosbags", ["report", "."], "pip install 'annik_ros[report]'"),
        ("onnxruntime", ["info", "gantry"], "pip install onnxruntime"),
        ("yaml", ["--help"], "pip install pyyaml"),
        ("click", ["--help"], "pip install click"),
    ],
)
def test_a_missing_library_is_named_with_what_installs_it(
    library: str, command: list[str], remedy: str
) -> None:
    script = (
        "import sys\n"
        # None in sys.modules is how Python is told that a module can't be imported.
        f"sys.modules[{library!r}] = None\n"
        f"sys.argv = ['annik', *{command!r}]\n"
        "from annik_training.cli import main\n"
        "main()\n"
    )
    result = run_python("-c", script)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("annik: ")
    assert library in line
    assert remedy in line


@pytest.mark.parametrize("module", ["annik_core.nothing", "nothing"])
def test_only_known_libraries_are_explained(monkeypatch: pytest.MonkeyPatch, module: str) -> None:
    """Any other failing import is a fault of annik or of a library, and keeps its traceback."""

    def fail() -> None:
        raise ModuleNotFoundError("No module", name=module)

    monkeypatch.setattr(cli_package, "cli", lambda **_: fail())
    with pytest.raises(ModuleNotFoundError) as caught:
        main()
    assert not isinstance(caught.value, AnnikError)


def test_the_urdf_of_a_model_is_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / "arm.urdf"
    result = invoke("export-urdf", "ur5e", "--out", path)
    assert result.exit_code == 0, result.output
    assert load_robot(path).joint_names == load_robot("ur5e").joint_names
    printed = invoke("export-urdf", "ur5e")
    assert (printed.exit_code, printed.output) == (0, path.read_text(encoding="utf-8"))


def test_the_gantry_has_a_urdf_too() -> None:
    result = invoke("export-urdf", "gantry")
    joints = {joint.get("name") for joint in ElementTree.fromstring(result.output).iter("joint")}
    assert set(load_robot("gantry").joint_names) < joints


def test_no_urdf_of_a_model_that_is_missing(tmp_path: Path) -> None:
    result = invoke("export-urdf", "no.onnx", "--out", tmp_path / "arm.urdf")
    assert result.exit_code == 1 and isinstance(result.exception, AnnikError)
    assert list(tmp_path.iterdir()) == []

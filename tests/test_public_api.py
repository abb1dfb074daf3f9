"""The public names: sorted, complete, documented, lazy; the README's example. ROS-free."""

from __future__ import annotations

import ast
import inspect
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from support.imperfect_ur5e import ImperfectUr5e, measured_ur5e
from support.processes import LONG_PATIENCE, ROOT, run_python

from annik_core import save_dataset

NAMES = {
    "annik_core": """
        AcceptanceLimits AnnikError CommandSafety Dataset IkResult IkServer IkSolver IkStatus Model
        RefinementOptions Robot SolverMode load_dataset load_model load_robot packaged_models
        packaged_robots save_dataset
    """,
    "annik_training": """
        CalibratedRobot CalibrationOptions Evaluation FitOptions TrainedModel calibrate
        design_names evaluate generate_dataset make_design train
    """,
    "msg_tools": """
        Bag BagNotFound BagNotReadable BagWriter TrackingReport joint_state_from_array
        joint_state_to_array pose_from_array pose_stamped_from_array pose_to_array read_bag
        tracking_report write_report
    """,
}

every_package = pytest.mark.parametrize("package", NAMES)


@every_package
def test_the_list_is_sorted_and_complete(package: str) -> None:
    """What type checkers see, what is loaded on first use, and the list are the same names."""
    module = import_module(package)
    assert module.__all__ == sorted(module.__all__) == NAMES[package].split() == dir(module)
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    (for_type_checkers,) = [node for node in tree.body if isinstance(node, ast.If)]
    homes = {
        alias.name: node.module
        for node in for_type_checkers.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(homes) == set(module.__all__)
    for name, home in homes.items():
        assert getattr(module, name) is getattr(import_module(str(home)), name)


@every_package
def test_a_star_import_gives_exactly_these_names(package: str) -> None:
    names: dict[str, object] = {}
    exec(f"from {package} import *", names)
    del names["__builtins__"]
    assert sorted(names) == NAMES[package].split()


@every_package
def test_each_name_says_what_it_is(package: str) -> None:
    module = import_module(package)
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name in module.__all__:
        value = getattr(module, name)
        assert inspect.getdoc(value), name
        assert f"| `{name}" in page


@every_package
def test_an_unknown_name_is_an_attribute_error(package: str) -> None:
    with pytest.raises(AttributeError) as caught:
        import_module(package).no_such_name  # noqa: B018
    assert "no_such_name" in str(caught.value)


@pytest.mark.process
@every_package
def test_importing_the_package_loads_nothing_heavy(package: str) -> None:
    """A node joins the graph before it loads onnxruntime."""
    script = (
        f"import sys, {package}\n"
        "heavy = {'numpy', 'onnx', 'onnxruntime', 'pinocchio', 'scipy', 'torch', 'yaml'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
        "print(sorted(name for name in sys.modules if name.startswith(('annik_', 'msg_'))))\n"
    )
    result = run_python("-c", script)
    loaded = sorted({"annik_core", "annik_core.lazy", package})
    assert result.stdout == f"[]\n{loaded}\n", result.stderr


@pytest.mark.process
@pytest.mark.slow
def test_the_example_of_the_readme_runs_as_it_stands(
    tmp_path: Path,
) -> None:
    """With poses that were measured on an arm that is not as described."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(from annik_core import.*?)```", readme, re.S)
    assert len(example.splitlines()) <= 11
    truth = ImperfectUr5e.drawn(1)
    save_dataset(measured_ur5e(truth, 30), tmp_path / "measured.npz")
    (tmp_path / "example.py").write_text(example, encoding="utf-8")
    result = run_python("example.py", cwd=tmp_path, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stderr
    numbers = np.array(re.findall(r"-?\d+\.\d*", result.stdout), dtype=np.float64)
    (reached,) = truth.poses(numbers[np.newaxis])
    assert np.linalg.norm(reached[:3] - [0.4, 0.1, 0.5]) < 3e-4

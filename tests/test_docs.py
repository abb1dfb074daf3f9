"""The documentation says what the code says: links, files, commands, parameters, figures."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path, PurePosixPath

import click
import pytest
from support.processes import ROOT

from annik_core.robots.library import packaged_robots
from annik_ros.launch_arguments import ARGUMENTS
from docs.parameter_tables import PARAMETER_TABLES
from msg_tools.topics import TOPICS

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
PACKAGES = ("annik_core", "annik_training", "msg_tools", "annik_ros")
#: What ``./run COMMAND`` hands its arguments to: the module and the name of its click command.
RUN_COMMANDS = {
    "train": ("annik_training.cli.train", "train"),
    "report": ("annik_training.cli.report", "report"),
    "paper": ("benchmarks.paper.command", "paper"),
    "study": ("benchmarks.study.command", "study"),
    "bench": ("benchmarks.__main__", "bench"),
    "demo": ("examples.demo", "main"),
    "learn": ("examples.learn", "main"),
}
#: Endings of the files that a page may name, apart from those that annik writes.
SOURCE_SUFFIXES = {".py", ".md", ".jinja", ".toml", ".xml", ".cfg", ".txt", ".sh"}

every_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix()
)


@cache
def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@cache
def prose_and_code(page: Path) -> tuple[str, tuple[tuple[str, str], ...]]:
    """A page without its code blocks, and the blocks: language, text."""
    blocks: list[tuple[str, str]] = []

    def take(match: re.Match[str]) -> str:
        blocks.append((match[1], match[2]))
        return "\n"

    prose = re.sub(r"^```(\w*)\n(.*?)^```$", take, text_of(page), flags=re.S | re.M)
    prose = re.sub(r"((?:^    .*\n)+)", lambda m: take_indented(m, blocks), prose, flags=re.M)
    return prose, tuple(blocks)


def take_indented(match: re.Match[str], blocks: list[tuple[str, str]]) -> str:
    blocks.append(("", match[1]))
    return "\n"


def inline_code(page: Path) -> list[str]:
    # A line may end inside of the code.
    return [
        " ".join(code.split())
        for code in re.findall(r"`([^`]+)`", prose_and_code(page)[0].replace("\\|", "|"))
    ]


@cache
def tracked_paths() -> frozenset[str]:
    """Files and folders of the checkout, folders with a slash at the end."""
    names = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    ).stdout.split()
    if not names:
        pytest.skip("not a git checkout")
    files = [name for name in names if (ROOT / name).exists()]
    folders = {f"{folder}/" for name in files for folder in PurePosixPath(name).parents}
    return frozenset(files) | folders


def is_in_checkout(path: str) -> bool:
    """Whether a file or a folder ends like this."""
    return any(f"/{known}".endswith(f"/{path}") for known in tracked_paths())


@cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", prose_and_code(page)[0], flags=re.M)
    plain = (re.sub(r"[`*]|\[|\]\([^)]*\)", "", heading).strip().lower() for heading in headings)
    return frozenset(re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain)


@pytest.mark.slow
def test_generated_tables_are_up_to_date(monkeypatch: pytest.MonkeyPatch) -> None:
    from docs import update_docs

    monkeypatch.setattr(sys, "argv", ["update_docs", "--check"])
    update_docs.main()


@every_page
def test_links_and_anchors_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", prose_and_code(page)[0]):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists(), target
        if anchor:
            assert anchor in anchors(file.resolve()), target


@every_page
def test_named_files_exist(page: Path) -> None:
    """Sources and folders in code; files that annik writes have other endings or names."""
    missing = set()
    for code in inline_code(page):
        path = code.rstrip(",.;")
        is_path = re.fullmatch(r"[\w.-]+(/[\w.-]+)*/?", path)
        if not is_path or path.startswith(("build/", "my_", ".", "doc/", "share/")):
            continue
        if re.search(r"\b(NAME|NODE|FILE|X)\b", path):
            continue
        is_source = PurePosixPath(path).suffix in SOURCE_SUFFIXES
        if (is_source or path.endswith("/")) and not is_in_checkout(path):
            missing.add(path)
    assert missing - WRITTEN == set()


#: What pages name that annik writes, or that a workspace has.
WRITTEN = {"paper.md", "study.md", "src/"}


# Commands


@cache
def run_usage() -> dict[str, str]:
    """The commands of ``./run``, and the lines that describe each."""
    script = (ROOT / "run").read_text(encoding="utf-8")
    usage = script.partition("cat <<'END'\n")[2].partition("\nEND\n")[0]
    commands: dict[str, str] = {}
    for line in usage.splitlines():
        if match := re.match(r"  ([a-z]+)\b", line):
            name = match[1]
            commands[name] = commands.get(name, "") + line
        elif line.startswith("   ") and commands:
            commands[name] += " " + line.strip()
    return commands


@cache
def annik() -> click.Group:
    # An editable install may be found twice.
    (name,) = {e.module for e in entry_points(group="console_scripts") if e.name == "annik"}
    group: click.Group = import_module(name).cli
    return group


def nodes() -> set[str]:
    return {
        entry.name
        for entry in entry_points(group="console_scripts")
        if entry.module.startswith("annik_ros.")
    }


def wrong_options(command: click.Command, words: list[str], name: str) -> list[str]:
    """Options among the words that neither the command nor its subcommand has."""
    context = click.Context(command, info_name=name, **command.context_settings)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        first = re.sub(r"[^\w-].*", "", words[0])
        if not first or first.isupper() or first in {"ARGUMENTS", "for"}:
            return []
        sub = command.get_command(context, first)
        if sub is None:
            return [f"{name} {first}"]
        command, words, name = sub, words[1:], f"{name} {first}"
        context = click.Context(command, info_name=name, **command.context_settings)
    known = {"--help", "-h", "--version"}
    for parameter in command.get_params(context):
        known |= {*parameter.opts, *parameter.secondary_opts}
    given = (re.match(r"--[a-z][\w-]*", word) for word in words)
    return [f"{name} {match[0]}" for match in given if match and match[0] not in known]


def wrong_in_command(line: str) -> list[str]:
    """What a line of a page calls and is not there: commands, options, nodes, parameters."""
    line = re.split(r"\s#|\s&&|\s\|\s|;", line)[0].strip().rstrip(".,:")
    words = line.split()
    if not words:
        return []
    program = words.pop(0)
    if program == "./run" or program.endswith("/run"):
        if not words or not re.fullmatch(r"[a-z]+", words[0]):
            return []
        name = words.pop(0)
        if name not in run_usage():
            return [f"./run {name}"]
        if name == "annik":
            return wrong_options(annik(), words, "annik")
        if name == "ros":
            return wrong_in_node(words)
        if name in RUN_COMMANDS:
            module, attribute = RUN_COMMANDS[name]
            return wrong_options(getattr(import_module(module), attribute), words, name)
        options = re.findall(r"^--[a-z-]+", " ".join(words))
        return [f"./run {name} {o}" for o in options if o not in run_usage()[name] + "--help"]
    if program == "annik":
        return wrong_options(annik(), words, "annik")
    if program == "ros2" and words[:2] == ["run", "annik_ros"]:
        return wrong_in_node(words[2:])
    if program == "ros2" and words[:2] == ["launch", "annik_ros"]:
        return [f for f in words[2:3] if not is_in_checkout(f"launch/{f}")]
    return []


def wrong_in_node(words: list[str]) -> list[str]:
    if not words or words[0].isupper():
        return []
    node, *rest = words
    if node not in nodes():
        return [f"no node {node}"]
    known = {row.name for row in PARAMETER_TABLES[node]} | {"use_sim_time"}
    given = re.findall(r"-p (\w+):=", " ".join(rest))
    return [f"{node} -p {name}" for name in given if name not in known]


@every_page
def test_commands_options_and_parameters_exist(page: Path) -> None:
    blocks = prose_and_code(page)[1]
    lines = [
        line
        for language, block in blocks
        if language in {"", "bash", "sh"}
        for line in block.replace("\\\n", " ").splitlines()
    ]
    wrong = [
        found
        for line in (*lines, *inline_code(page))
        for part in re.split(r"\s&&\s", line)
        for found in wrong_in_command(part.strip())
    ]
    assert wrong == []


@every_page
def test_parameters_in_the_text_exist(page: Path) -> None:
    """``name:=value`` is a parameter of some node, a topic that is remapped, or of ROS itself."""
    known = {row.name for table in PARAMETER_TABLES.values() for row in table}
    known |= {topic.name for topic in TOPICS}
    known |= {"use_sim_time", "__ns", "__node"}
    given = set(re.findall(r"(?<![\w/])(\w+):=", " ".join(inline_code(page))))
    assert given - known <= set(ARGUMENTS)


@cache
# Python


@every_page
def test_python_in_the_pages_compiles_and_its_imports_exist(page: Path) -> None:
    for language, block in prose_and_code(page)[1]:
        if language != "python":
            continue
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    import_module(alias.name)
            elif isinstance(node, ast.ImportFrom) and node.module:
                module = import_module(node.module)
                for alias in node.names:
                    assert hasattr(module, alias.name), f"{node.module}.{alias.name}"


# What pages share


def test_the_architecture_names_every_module_and_room() -> None:
    """Directly in a package: those inside a room are found by their names."""
    page = text_of(ROOT / "docs" / "architecture.md")
    for package in PACKAGES:
        for path in sorted((ROOT / package).iterdir()):
            if path.is_dir() and any(path.glob("*.py")):
                assert f"`{path.name}/`" in page, path
    core = [path for path in (ROOT / "annik_core").glob("[!_]*.py")]
    for path in (*core, *(ROOT / "annik_training").glob("[!_]*.py")):
        assert f"`{path.name}`" in page, path


def test_figures_that_pages_share_agree() -> None:
    readme, contributing = text_of(ROOT / "README.md"), text_of(ROOT / "CONTRIBUTING.md")
    paper = text_of(ROOT / "docs" / "paper.md")
    run = (ROOT / "run").read_text(encoding="utf-8")
    # The paper's printed errors of Sets 2 and 3, and their numbers of examples.
    printed = re.search(r"\| worst of 9, printed \|(.*)\|", paper)
    assert printed
    for error in printed[1].split("|")[1:3]:
        assert f"{error.strip()} mm" in readme
    for size in re.findall(r"\| Set [23]: j = \d+ \| \d+ \| (\d+) \|", paper):
        assert size in readme
    # The demo's number of examples is that of the paper's Set 2 here.
    (examples,) = re.findall(r"\| Set 2: j = 6 \| (\d+) \|", paper)
    assert f"| examples | {examples} |" in readme
    assert f"train on {examples} examples" in readme
    assert f"train on {examples} examples" in run_usage()["demo"]
    # Requirements.
    for requirement in ("glibc 2.28 or later", "Python 3.10 to 3.13"):
        for text in (readme, contributing, run):
            assert requirement in " ".join(text.split())
    for disk in ("10 GB", "3 GB"):
        assert disk in readme
        assert disk in contributing
    assert "10 GB" in run
    # The packaged arms.
    for robot in packaged_robots():
        assert robot in readme


def test_no_page_names_a_file_of_somewhere_else() -> None:
    for page in PAGES:
        assert "design.md" not in text_of(page), page


def outputs(page: Path) -> set[str]:
    """The files and folders that the commands of a page write into the current folder."""
    code = "\n".join(text for _, text in prose_and_code(page)[1])
    written = re.findall(r"--(?:out|save|plot|summary)[ =](\S+)|\b(?:output|dataset):=(\S+)", code)
    names = {option or parameter for option, parameter in written}
    names |= set(re.findall(r'^train\(.*"([^"]+)"\)', code, re.M))
    # The journal beside it, until the dataset is whole.
    names |= {str(Path(name).with_suffix(".journal.jsonl")) for name in names if ".npz" in name}
    return {name for name in names if not name.startswith(("/", "$", "~", "<"))}


@every_page
def test_the_commands_leave_nothing_untracked_in_the_checkout(page: Path) -> None:
    names = outputs(page)
    if page.name == "README.md":
        assert {"my_bag", "model.onnx", "measured.journal.jsonl", "ur5e.onnx"} <= names
        names |= {"annik_bag_2026-01-31_12-00-00", "rosbag2_2026_01_31-12_00_00"}
    if not names:
        return
    asked = ("git", "check-ignore", "--no-index", *names)
    told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    if told.returncode == 128:
        pytest.skip("not a git checkout")
    assert names <= set(told.stdout.split())

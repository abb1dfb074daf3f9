"""The documentation as a site: built strictly, with every public name. ROS-free."""

from __future__ import annotations

import html
import inspect
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from support.processes import LONG_PATIENCE, ROOT

pytest.importorskip("mkdocs", reason="the site needs mkdocs: pip install 'annik_ros[docs]'")

pytestmark = pytest.mark.process


def build(site: Path, configuration: Path = ROOT / "mkdocs.yml") -> tuple[int, str]:
    """Exit code, and what was printed. It must not be told to be quiet: it would not be strict."""
    result = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "-f", configuration, "-d", site],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=LONG_PATIENCE,
        check=False,
    )
    return result.returncode, result.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    code, printed = build(folder)
    assert code == 0, printed
    return folder


def text_of(page: Path) -> str:
    """What is read on a page: without code blocks and marks."""
    text = re.sub(
        r"<(pre|script|style)\b.*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.S
    )
    return " ".join(html.unescape(re.sub(r"<[^>]+>", "", text)).split())


@pytest.mark.parametrize("package", ["annik_core", "annik_training", "msg_tools"])
def test_every_public_name_has_its_docstring(site: Path, package: str) -> None:
    page = site / "api" / f"{package}.html"
    anchors = set(re.findall(r'id="([^"]+)"', page.read_text(encoding="utf-8")))
    read = text_of(page)
    module = import_module(package)
    for name in module.__all__:
        assert f"{package}.{name}" in anchors
        sentence = str(inspect.getdoc(getattr(module, name))).partition("\n\n")[0]
        plain = re.sub(r":\w+:`~?(?:\w+\.)*(\w+)`|``", r"\1", " ".join(sentence.split()))
        assert plain in read, name


def test_options_say_what_they_are(site: Path) -> None:
    """The sentence of a setting, and of a ``#:`` comment."""
    read = text_of(site / "api" / "annik_training.html")
    assert "Connect the inputs to the outputs directly too." in read
    assert "Fraction of the network's joint positions outside the joint limits." in read


def test_pages_are_rendered_whole(site: Path) -> None:
    """No mark of Markdown is left in the text; the pages from outside docs/ are there."""
    pages = {page.relative_to(site).as_posix(): text_of(page) for page in site.rglob("*.html")}
    assert {"index.html", "contributing.html", "changelog.html", "api.html"} <= set(pages)
    for name, text in pages.items():
        found = re.search(r"\]\(|\| --- \||```|<!--|:\w+:`|\*\*\w", text)
        assert found is None, (name, found)


def test_figures_are_there_and_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = re.findall(
            r'<(?:img|script|link)\b[^>]*?(?:src|href)="([^"]+)"', page.read_text(encoding="utf-8")
        )
        assert not [source for source in loaded if source.startswith("http")], page
        if page.name != "404.html":
            assert all((page.parent / source).exists() for source in loaded), page


def test_search_finds_pages_and_names(site: Path) -> None:
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    for location in ("learn_your_robot.html", "api/annik_core.html#annik_core.IkSolver.solve"):
        assert f'"location":"{location}"' in index


FAULTS = """# Faults

[no page](no_such_page.md), [no anchor](good.md#no-such-anchor), [no file](../no_such_file.py),
[no reference][annik_core.NoSuchName] ![no picture](images/no_such_picture.png)
"""


def test_every_kind_of_broken_link_fails(tmp_path: Path) -> None:
    """By the configuration of the site, with other pages."""
    pages = tmp_path / "docs"
    pages.mkdir()
    (pages / "index.md").write_text(FAULTS, encoding="utf-8")
    (pages / "good.md").write_text("# Good\n", encoding="utf-8")
    (pages / "not_in_nav.md").write_text("# Good\n", encoding="utf-8")
    shutil.copy(ROOT / "docs" / "site.css", pages)
    configuration = tmp_path / "mkdocs.yml"
    inherited = {"INHERIT": str(ROOT / "mkdocs.yml"), "docs_dir": "docs", "hooks": []}
    nav = {"nav": ["index.md", "good.md"]}
    configuration.write_text(yaml.safe_dump({**inherited, **nav}), encoding="utf-8")
    code, printed = build(tmp_path / "site", configuration)
    assert code == 1
    for name in ("page.md", "anchor", "file.py", "Name", "picture.png"):
        assert re.search(rf"no.?such.?{name}", printed, re.I), name
    assert "not_in_nav.md" in printed

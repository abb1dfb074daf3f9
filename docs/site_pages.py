"""Pages of the site beside those in docs/, and links between them: a hook of MkDocs.

The pages are written for GitHub: a link may lead to any file of the repository. In the site it
leads to the page of that file, or to the file on GitHub if the site has none.
"""

from __future__ import annotations

import base64
import json
import posixpath
import re
from importlib import import_module
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
#: Pages of the site by the file of the repository that they are made of.
OTHER_PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "docs/few_examples.ipynb": "few_examples.md",
}
#: Packages whose public names have a page with their docstrings.
API_PACKAGES = ("annik_core", "annik_training", "msg_tools")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made of files outside docs/, and those of the public names."""
    pages: dict[str, str | bytes] = {}
    for file, page in OTHER_PAGES.items():
        text = (ROOT / file).read_text(encoding="utf-8")
        if file.endswith(".ipynb"):
            text, figures = notebook_page(json.loads(text), Path(page).stem)
            pages |= figures
        pages[page] = text
    pages |= {f"api/{package}.md": api_page(package) for package in API_PACKAGES}
    for page, text in pages.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead the links to pages of the site; give a page without a heading its title."""
    here = page.file.src_uri
    markdown = re.sub(r"^<!--.*?-->$", "", markdown, flags=re.M)  # it would be part of a table
    if here == "api.md":
        markdown = with_links_to_docstrings(markdown)
    sources = {made: source for source, made in OTHER_PAGES.items()}
    folder = posixpath.dirname(sources.get(here, f"docs/{here}"))

    def led(link: re.Match[str]) -> str:
        path, mark, anchor = link[1].partition("#")
        file = posixpath.normpath(posixpath.join(folder, path))
        target = OTHER_PAGES.get(file, file.removeprefix("docs/"))
        if "://" in link[1] or not path or not (ROOT / file).exists():
            return link[0]
        if files.get_file_from_path(target) is None:
            return f"]({config.repo_url}/blob/main/{file})"
        return f"]({posixpath.relpath(target, posixpath.dirname(here) or '.')}{mark}{anchor})"

    text_and_code = re.split(r"(^```.*?^```$)", markdown, flags=re.M | re.S)
    text_and_code[::2] = [re.sub(r"\]\(([^)\s]+)\)", led, text) for text in text_and_code[::2]]
    markdown = "".join(text_and_code)
    return markdown if markdown.lstrip().startswith("# ") else f"# {page.title}\n{markdown}"


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let long names in tables be broken at their parts."""

    def breakable(code: re.Match[str]) -> str:
        return re.sub(r"(?<=\w)([/_])(?=\w)", r"\1<wbr>", code[0])

    def in_cell(cell: re.Match[str]) -> str:
        return re.sub(r"(?<=<code>)[^<]+(?=</code>)", breakable, cell[0])

    return re.sub(r"<td.*?</td>", in_cell, html, flags=re.S)


def notebook_page(notebook: dict[str, Any], name: str) -> tuple[str, dict[str, bytes]]:
    """A notebook with what it shows as Markdown, and its figures by the names of their files."""
    parts: list[str] = []
    figures: dict[str, bytes] = {}
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            if output["output_type"] == "stream":
                parts.append(f"```text\n{''.join(output['text'])}```")
            elif "image/png" in output.get("data", {}):
                figure = f"images/{name}_{len(figures)}.png"
                figures[figure] = base64.b64decode(output["data"]["image/png"])
                parts.append(f"![Figure {len(figures)}]({figure})")
    return "\n\n".join(parts), figures


def api_page(package: str) -> str:
    """The public names of a package, for mkdocstrings to put their docstrings in."""
    module = import_module(package)
    summary = str(module.__doc__).partition("\n")[0]
    summary = summary.replace("docs/api.md", "[the overview](../api.md)")
    return "\n\n".join(
        [f"# {package}", summary, *(f"::: {package}.{name}" for name in module.__all__)]
    )


def with_links_to_docstrings(markdown: str) -> str:
    """The tables of public names, each name a link to its docstring."""
    package = ""
    lines = markdown.splitlines()
    for number, line in enumerate(lines):
        if line.startswith("## "):
            package = line.removeprefix("## ")
        elif row := re.match(r"\| `(\w+)(.*?)` \|", line):
            link = f"| [`{row[1]}{row[2]}`][{package}.{row[1]}] |"
            lines[number] = link + line[row.end() :]
    return "\n".join(lines)

"""Docstrings as the pages of the site need them: an extension of griffe, see mkdocs.yml."""

from __future__ import annotations

import ast
import re
from typing import Any

import griffe


class Docstrings(griffe.Extension):
    """Sentences of settings and of ``#:`` comments are docstrings; references are links."""

    def on_attribute_instance(self, *, node: Any, attr: griffe.Attribute, **_: Any) -> None:
        """Take the sentence of an attribute from where the source has it."""
        text = sentence_of_setting(node)
        if text:
            attr.value = attr.value.arguments[0]  # the default, for the signature
        else:
            text = comment_of(attr)
        if text and attr.docstring is None:
            attr.docstring = griffe.Docstring(text, parent=attr)

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Write the references of a docstring as links, where there is something to lead to."""

        def link(role: re.Match[str]) -> str:
            path = role[1]
            name = path.rpartition(".")[2]
            try:
                path = obj.resolve(path) if "." not in path else path
            except griffe.NameResolutionError:
                return f"`{name}`"
            return f'<autoref identifier="{path}" optional><code>{name}</code></autoref>'

        if obj.docstring:
            obj.docstring.value = re.sub(r":\w+:`~?([\w.]+)`", link, obj.docstring.value)


def sentence_of_setting(node: Any) -> str | None:
    """The sentence in ``name: type = setting(default, "Sentence.", ...)``."""
    value = getattr(node, "value", None)
    if not isinstance(value, ast.Call) or len(value.args) < 2:
        return None
    sentence = value.args[1]
    if isinstance(sentence, ast.Constant) and isinstance(sentence.value, str):
        return sentence.value
    return None


def comment_of(attr: griffe.Attribute) -> str | None:
    """The comment ``#:`` behind an attribute, or in the lines above it."""
    if attr.lineno is None or attr.endlineno is None:
        return None
    lines = attr.lines_collection[attr.filepath]
    _, mark, behind = lines[attr.endlineno - 1].partition("#:")
    if mark:
        return behind.strip()
    above = []
    for line in reversed(lines[: attr.lineno - 1]):
        if not line.strip().startswith("#:"):
            break
        above.insert(0, line.strip().removeprefix("#:").strip())
    return " ".join(above) or None

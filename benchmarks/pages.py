"""Pages in Markdown from templates: the words are in the template, the numbers in the results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jinja2


def rendered(
    template: Path,
    filters: Mapping[str, Callable[..., str]] | None = None,
    **values: Any,
) -> str:
    """A page.

    Args:
        template: the file.
        filters: for values that the template formats itself.
        values: what it uses.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters.update(filters or {})
    return environment.from_string(template.read_text(encoding="utf-8")).render(values)

"""Sphinx makes a site of the pages in docs/ (`make docs`). Its sources are the whole repository: a link of a page then leads
to the same file in the site and in the repository.
"""

from __future__ import annotations

import inspect
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

project, project_copyright = "REBAR", "The REBAR developers"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/site/index"
include_patterns = ["*.md", "docs/**", "docker/*.md", "examples/**/*.md", "tests/**/*.md"]
exclude_patterns = ["**/node_modules"]
html_theme = "furo"
html_title = "REBAR"
html_copy_source = False
highlight_language = "none"  # most blocks are commands and what they print
smartquotes = False
myst_heading_anchors = 6
autodoc_default_options = {"members": True, "special-members": "__call__", "exclude-members": "model_config"}
maximum_signature_line_length = 100

# A face says in its source what it offers; most fetch it when it is first used, and Sphinx asks only what is there.
for name in ("agent_adapters.client", "bench.contracts", "bench.streams"):
    face: Any = import_module(name)
    face.__all__ = re.findall(
        r"^ *from \S+ import (\w+) as \1$", Path(face.__file__).read_text(), re.MULTILINE
    )
    for offered in face.__all__:
        getattr(face, offered)


def read_plainly(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with `code` and indented examples: reStructuredText is to read nothing else into them."""
    paragraphs = []
    for paragraph in "\n".join(lines).split("\n\n"):
        if paragraph.startswith(" "):
            paragraphs.append(f"::\n\n{paragraph}")
            continue
        parts = re.split(r"`([^`]+)`", paragraph)
        parts[::2] = [re.sub(r"[*|\\]|_\b", r"\\\g<0>", part) for part in parts[::2]]
        paragraphs.append("``".join(parts))
    lines[:] = "\n\n".join(paragraphs).split("\n")


def show_fields(
    app: Any, what: str, name: str, thing: Any, options: Any, signature: str, returned: str
) -> tuple[str, str] | None:
    """The fields of a class with their types as its source has them; nothing for a protocol, which nobody calls."""
    if what != "class" or getattr(thing, "_is_protocol", False):
        return ("", returned) if what == "class" else None
    fields: dict[str, Any] = {}
    for base in reversed(thing.__mro__):
        fields |= inspect.get_annotations(base)
    shown = [
        f"{field}: {kind if isinstance(kind, str) else inspect.formatannotation(kind)}"
        for field, kind in fields.items()
        if field.islower() and field[0] != "_" and "ClassVar" not in str(kind)
    ]
    return (f"({', '.join(shown)})", returned) if shown else None


def write_entrance(app: Any, error: Exception | None) -> None:
    """The page that servers and people look for, at the root of the site."""
    entrance = f'<meta http-equiv="refresh" content="0; url={root_doc}.html">'
    (Path(app.outdir) / "index.html").write_text(entrance, encoding="utf-8")


def setup(app: Any) -> None:
    """What Sphinx calls."""
    app.connect("autodoc-process-docstring", read_plainly)
    app.connect("autodoc-process-signature", show_fields)
    app.connect("build-finished", write_entrance)

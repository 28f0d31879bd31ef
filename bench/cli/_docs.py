"""`rebar docs`: the pages of docs/ in a browser, made from their Markdown where they are asked for."""

from __future__ import annotations

import difflib
import html
import os
import re
import sys
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.errors import SetupError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from markdown_it.token import Token

# What pages of docs/ link to beside each other.
TOP_PAGES = ("README.md", "CONTRIBUTING.md")
_SHELL = """<!doctype html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title} - REBAR</title>
<style>
:root {{ color-scheme: light dark }}
body {{ max-width: 60rem; margin: 2rem auto; padding: 0 1rem; font: 1rem/1.5 system-ui, sans-serif }}
table {{ border-collapse: collapse; display: block; overflow-x: auto }}
th, td {{ border: 1px solid #8886; padding: .3rem .6rem; text-align: left; vertical-align: top }}
pre {{ overflow-x: auto; padding: .6rem; background: #8882 }}
img {{ max-width: 100% }}
</style>
<p><a href="{index}">All pages</a></p>
{body}
"""


def docs(
    page: Annotated[str, typer.Argument(help="Name of a page, such as simspec")] = "README",
    path: Annotated[
        bool, typer.Option("--path", help="Print the path of the page, and open nothing")
    ] = False,
) -> None:
    """Open a page of the documentation in the browser. Without a display, only its path is printed. It needs no network.

    Example: rebar docs

    Example: rebar docs simspec --path
    """
    from bench.temporary_folders import user_cache

    from ._examples import shipped

    root = shipped("docs/README.md").parents[1]
    name = page.removesuffix(".md")
    names = sorted(source.stem for source in (root / "docs").glob("*.md"))
    if name not in names:
        close = difflib.get_close_matches(name, names, n=1)
        meant = f"did you mean {close[0]}? There are" if close else "there are"
        raise SetupError("PAGE", f"there is no page {page!r}", f"{meant} {', '.join(names)}")
    target = user_cache() / "docs"
    write_pages(root, target)
    opened = target / "docs" / f"{name}.html"
    print(opened)
    # Without a display, `webbrowser` would start a text browser in this terminal.
    if not path and (sys.platform == "darwin" or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
        import webbrowser

        webbrowser.open(opened.as_uri())


def write_pages(root: Path, target: Path) -> None:
    """Write each page below `root` as HTML to the same place below `target`. Pictures and other files stay where they are."""
    from markdown_it import MarkdownIt

    markdown = MarkdownIt("commonmark").enable("table")
    sources = [*sorted((root / "docs").glob("*.md")), *(root / name for name in TOP_PAGES)]
    for source in sources:
        written = target / source.relative_to(root).with_suffix(".html")
        written.parent.mkdir(parents=True, exist_ok=True)
        tokens = markdown.parse(source.read_text(encoding="utf-8"))
        titles = list(_name_headings(tokens))
        for token in (child for block in tokens for child in block.children or ()):
            _lead(token, source, sources)
        body = markdown.renderer.render(tokens, markdown.options, {})
        index = os.path.relpath(target / "docs" / "README.html", written.parent)
        page = _SHELL.format(title=html.escape(titles[0]), index=index, body=body)
        written.write_text(page, encoding="utf-8")


def _name_headings(tokens: list[Token]) -> Iterator[str]:
    """The headings, each given the anchor by which pages link to it: that of common Markdown renderers."""
    for token, content in pairwise(tokens):
        if token.type == "heading_open":
            token.attrSet("id", re.sub(r"[^\w\- ]", "", content.content.lower()).replace(" ", "-"))
            yield content.content


def _lead(token: Token, source: Path, sources: list[Path]) -> None:
    """Lead a link or picture of a page to the written page, or to the file where it lies; text remains of one to a file
    that does not come with the distribution.
    """
    attribute = {"link_open": "href", "image": "src"}.get(token.type)
    if attribute is None or re.match(r"\w+:|#", link := str(token.attrs[attribute])):
        return
    path, mark, anchor = link.partition("#")
    goal = Path(os.path.normpath(source.parent / path))
    if goal in sources:
        token.attrSet(attribute, f"{Path(path).with_suffix('.html').as_posix()}{mark}{anchor}")
    elif goal.exists():
        token.attrSet(attribute, goal.as_uri())
    else:
        del token.attrs[attribute]

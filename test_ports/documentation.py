"""The tables of measures in docs/measures.md, written from the declarations: `python -m
test_ports.documentation`.

The page has a pair of markers for each module with measures. The text between them is replaced.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Literal, get_args, get_origin

import test_ports
from bench.contracts import Option

from ._declaration import DeclaredMeasure, DeclaredOption

PAGE = Path(__file__).parent.parent / "docs" / "measures.md"

PAGE_WIDTH = 110
"""Columns of the lines of docs/. Rows of a table may be longer."""

SECTION = re.compile(r"<!-- measures of ([\w.]+) -->\n.*?<!-- end -->\n", re.DOTALL)


def measure_modules() -> Iterator[ModuleType]:
    """Every module of this package that declares measures, by name."""
    for info in pkgutil.walk_packages(test_ports.__path__, "test_ports."):
        module = importlib.import_module(info.name)
        if declared_in(module):
            yield module


def declared_in(module: ModuleType) -> list[DeclaredMeasure]:
    """The measures that a module declares, in the order of the source; not those that it imports."""
    # The dict of a module keeps the order of its source.
    return [
        measure
        for measure in vars(module).values()
        if isinstance(measure, DeclaredMeasure) and measure.find.__module__ == module.__name__
    ]


def with_tables(page: str) -> str:
    """The page with its tables updated.

    Raises ValueError when a module with measures has no section, or two.
    """
    written: list[str] = []

    def section(match: re.Match[str]) -> str:
        written.append(match[1])
        return f"<!-- measures of {match[1]} -->\n{section_text(importlib.import_module(match[1]))}<!-- end -->\n"

    # A function as replacement: a backslash in a docstring would be read as an escape in a template.
    page = SECTION.sub(section, page)
    expected = sorted(module.__name__ for module in measure_modules())
    if sorted(written) != expected:
        raise ValueError(
            f"the page has sections for {', '.join(sorted(written))}; modules with measures: {', '.join(expected)}"
        )
    return page


def section_text(module: ModuleType) -> str:
    """The introduction of a module, its table of measures and options, and the description of each
    measure.
    """
    introduction = inspect.getdoc(module) or ""
    _, _, conventions = introduction.partition("\n\n")
    lines = ["| measure | options (default) |", "| --- | --- |"]
    for measure in declared_in(module):
        options = "; ".join(_option_text(option) for option in measure.options)
        lines.append(f"| `{measure.name}` | {options or 'none'} |")
    paragraphs = [conventions, "\n".join(lines)]
    paragraphs += [_described(measure) for measure in declared_in(module)]
    return "".join(f"{paragraph}\n\n" for paragraph in paragraphs if paragraph)


def _described(measure: DeclaredMeasure) -> str:
    # Only the first paragraph gets the name before it, so only that one is wrapped again: a docstring may
    # hold a list.
    summary, _, details = measure.description.partition("\n\n")
    named = f"**`{measure.name}`**: {summary}"
    wrapped = textwrap.fill(named, PAGE_WIDTH, break_long_words=False, break_on_hyphens=False)
    return f"{wrapped}\n\n{details}" if details else wrapped


def _option_text(option: DeclaredOption) -> str:
    text = f"`{option.name}`"
    if get_origin(option.kind) is Literal:
        *values, last = (_value_text(value) for value in get_args(option.kind))
        text += f": {', '.join(values)} or {last}"
    return text if option.default is None else f"{text} ({_value_text(option.default)})"


def _value_text(value: Option) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value) or '""'


def main(arguments: list[str] | None = None) -> int:
    """Write the tables, or with `--check` only say whether the page is up to date.

    Returns the exit status.
    """
    parser = argparse.ArgumentParser(
        description="Write the tables of measures in docs/measures.md from the code."
    )
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit with 1 when the page is out of date"
    )
    check = parser.parse_args(arguments).check
    page = PAGE.read_text(encoding="utf-8")
    updated = with_tables(page)
    if check and updated != page:
        print(f"{PAGE} is out of date; run `python -m test_ports.documentation`", file=sys.stderr)
        return 1
    if not check:
        PAGE.write_text(updated, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

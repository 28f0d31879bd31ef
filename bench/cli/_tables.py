"""Tables that fit into the width of the terminal, 80 columns in a pipe: nothing in them is cut."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Collection, Iterable, Sequence
from typing import Any, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from bench.visible_text import terminal_of, visible

# Beside it, the widest table here (`rebar compare`) still fits into 80 columns.
MAX_NAME_CHARACTERS = 20
CONTINUATION_INDENT = 2


class _VisibleConsole(Console):
    """Texts are `visible` in it, before they are laid out; the control codes are its own."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(visible(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        if isinstance(renderable, Text):
            renderable = renderable.copy()
            renderable.plain = visible(renderable.plain)
        return super().render(renderable, options)


def plain_console(stream: TextIO | None = None, width: int | None = None) -> Console:
    """A console that prints text as it is, to stdout unless another stream is named. No other kind is to be used.

    Without highlighting and markup: rich would colour the numbers inside names, and drop or obey what stands in brackets.
    """
    file = terminal_of(stream or sys.stdout)
    return _VisibleConsole(file=file, width=width, highlight=False, markup=False, emoji=False)


def plain_table(columns: Sequence[str], *, texts: Collection[str] = ()) -> Table:
    """A table without vertical lines and without a title, one space between columns. Fill it with `add_plain_row`.

    Print a title before it as a line: rich would wrap it at the width of the table.

    The columns named in `texts`, and the first one, are left-aligned and wrap, so that numbers stay whole.
    """
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, column in enumerate(columns):
        is_text = place == 0 or column in texts
        # Folded, where a name is longer than its column: a name that is cut cannot be searched or copied.
        table.add_column(
            column, justify="left" if is_text else "right", no_wrap=place == 0 or not is_text, overflow="fold"
        )
    return table


def add_plain_row(table: Table, cells: Sequence[str]) -> None:
    """A row of a plain table; every cell is shown as it is."""
    # A longer name than this is folded: the numbers beside it would not fit.
    if len(cells[0]) > MAX_NAME_CHARACTERS:
        table.columns[0].no_wrap = False
    # As Text, because rich would take a name in brackets for markup.
    table.add_row(*map(Text, cells))


def print_lines(*lines: str) -> None:
    """Print sentences, each from a new line and wrapped between words at the width of the terminal.

    What follows on further lines is indented. A path or a name wider than the terminal stays whole.
    """
    width = plain_console().width
    for line in lines:
        indent = len(line) - len(line.lstrip())
        print(wrapped(line, width, indent + CONTINUATION_INDENT))


def wrapped(text: str, width: int, indent: int, first: str = "") -> str:
    """`text` in lines of at most `width` characters; `first` stands before it, `indent` spaces before the rest."""
    # By the standard library: rich breaks a word that is wider than the line, and what is broken cannot be copied.
    return textwrap.fill(
        text,
        width,
        initial_indent=first,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )

"""What an agent, a vehicle or a file from elsewhere wrote, shown so that every character is seen.

Such a text may hold what clears a terminal, sets its title, writes its clipboard or turns the order of letters round.
Here is the one place that shows these characters as escapes. It is used twice. Documents that keep such a text (results,
and with them journal and events) take it as `visible`. And whatever the bench prints, writes as JSON or YAML, or lays
out as HTML goes through it, so that no text is missed. What is kept as evidence, an agent's output and its recorded
messages, stays as it was.
"""

from __future__ import annotations

import codecs
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TextIO

# Controls without tab and newline, soft hyphen, zero-width and bidirectional marks, separators of lines and paragraphs:
# Unicode's categories Cc, Cf, Zl and Zp up to U+FFFF, without the signs among them that are seen (Arabic and Syriac).
# Written as escapes that Python, JSON Schema (ECMA 262) and pydantic (Rust) read alike.
_UNSEEN = (
    r"\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
)
# Also halves of characters, and the marks beyond U+FFFF: of hieroglyphs, shorthand and music; tags.
# Compiled when it is first used: every agent that writes documents imports this module.
_HIDDEN = rf"[{_UNSEEN}\ud800-\udfff\U00013430-\U0001343f\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e00ff]"
_SEEN_ASCII = bytes([9, 10, *range(32, 127)])
VISIBLE_LABEL = rf"^[^\t\n{_UNSEEN}]*$"
"""Pattern of a JSON Schema: a label of one line without controls and marks that are not seen."""

# What the bench itself prints and ASCII, latin-1 or cp1252 lack.
_PLAINER = dict(zip("–—−─×·•†’“”²", '----x-*+\'""2', strict=True)) | {
    "≤": "<=",
    "≥": ">=",
    "…": "...",
    "°": " deg",
}


def visible(text: str) -> str:
    """The text with a visible escape in place of each character that is not seen; newlines and tabs stay.

    ESC becomes `\\x1b`, a bidirectional mark `\\u202e`: in JSON text, whose own escapes leave only the latter kind, that is
    the same string.
    """
    # Results and SimSpecs go through here by the thousand: 1 ns for a character, where the search takes 100 ns.
    if text.isascii() and not text.encode().translate(None, _SEEN_ASCII):
        return text
    # What Python calls printable is seen: 15 ns.
    return (
        text
        if text.replace("\n", "").isprintable()
        else re.sub(_HIDDEN, lambda match: _escaped(match[0]), text)
    )


def visible_values(value: Any) -> Any:
    """Plain values, as JSON has them, with every text in them `visible`."""
    match value:
        case str():
            return visible(value)
        case dict():
            return {visible_values(name): visible_values(part) for name, part in value.items()}
        case list() | tuple():
            return [visible_values(part) for part in value]
        case _:
            return value


def _escaped(sign: str) -> str:
    if sign < " ":
        return f"\\x{ord(sign):02x}"
    # In units of UTF-16, because JSON knows no other escape of a character beyond U+FFFF.
    units = sign.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{units[at : at + 4]}" for at in range(0, len(units), 4))


class _VisibleStream:
    """A text stream to which only what is `visible` is written."""

    # Libraries that find a stream's bytes write past `write`.
    buffer = None

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        return self.stream.write(visible(text))

    def writelines(self, lines: Iterable[str]) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def visible_output() -> Iterator[None]:
    """Let everything that is written to stdout and stderr meanwhile be `visible`, and written in every encoding: what
    the encoding of the terminal lacks is replaced by what looks like it, or escaped.
    """
    for stream in (sys.stdout, sys.stderr):
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors=_ERRORS)
    # None where the process was started without it.
    with (
        redirect_stdout(sys.stdout and _VisibleStream(sys.stdout)),
        redirect_stderr(sys.stderr and _VisibleStream(sys.stderr)),
    ):
        yield


def terminal_of(stream: Any) -> TextIO:
    """The stream below `visible_output`: for what shows texts itself and also writes control codes of its own."""
    terminal: TextIO = terminal_of(stream.stream) if isinstance(stream, _VisibleStream) else stream
    return terminal


def _plainer(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    lacking = error.object[error.start : error.end]
    return "".join(_PLAINER.get(sign) or _escaped(sign) for sign in lacking), error.end


_ERRORS = "rebar-plainer"
codecs.register_error(_ERRORS, _plainer)

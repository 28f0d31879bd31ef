"""Plain values of YAML and JSON text with their lines, and YAML text of plain values.

YAML 1.1, YAML 1.2 and JSON differ in what they take for a number. A number here is decimal and means what it seems to
mean (`45`, `+5`, `.5`, `1e3`). What one of them reads as another number (`045`, `1:30`, `0x1F`, `1_000`) is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NoReturn

import yaml

from ..errors import MAX_FAULTS, Fault, SetupError
from ..visible_text import visible

DocumentPath = tuple[str | int, ...]
PlainScalar = str | int | float | bool | None

# What 16 MiB hold of a document as the bench writes it: campaigns/standard.yaml with all defaults, 20 situations, takes
# 20.8 bytes for each of its 10,815 values, keys not counted. The largest shipped file that is written by hand has 6,246.
MAX_VALUES = 800_000
# Each unknown key is a fault of its own. The largest shipped mapping has 101.
MAX_KEYS = 20_000
# The deepest shipped file has 11.
MAX_DEPTH = 64
# PyYAML's own parser takes 15 us for a value, libyaml's 1 us. The largest shipped file has 107,000 characters.
MAX_REREAD_CHARACTERS = 1_000_000

_WORDS: Mapping[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE", "yes", "Yes", "YES", "on", "On", "ON"), True),
    **dict.fromkeys(("false", "False", "FALSE", "no", "No", "NO", "off", "Off", "OFF"), False),
}
_WHOLE = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_DECIMAL = re.compile(r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NUMBER_BEGINNINGS = frozenset("0123456789+-.")


def _without_zeros(text: str) -> str:
    return re.sub(r"^([-+]?)0+(?=[0-9])", r"\1", text.replace("_", ""))


# The first that fits, with what to write in its place.
_REFUSED: Sequence[tuple[re.Pattern[str], str, Callable[[str], str]]] = (
    (
        re.compile(r"[-+]?([1-9][0-9_]*(:[0-5]?[0-9])+|[0-9][0-9_]*(:[0-5]?[0-9])+\.[0-9_]*)"),
        "is a number to base 60 for some readers of YAML, and text for others",
        lambda text: "one number in the unit of the field",
    ),
    (
        re.compile(r"[-+]?0([xX]_*[0-9a-fA-F][0-9a-fA-F_]*|[oO]_*[0-7][0-7_]*|[bB]_*[01][01_]*)"),
        "is a number for some readers of YAML, and text for others",
        lambda text: str(int(text.replace("_", ""), 0)),
    ),
    (
        re.compile(r"[-+]?0[0-9_]+(\.[0-9_]*)?([eE][-+]?[0-9]+)?"),
        "begins with 0, which makes it an octal number for some readers of YAML",
        _without_zeros,
    ),
    (
        re.compile(r"[-+]?([0-9][0-9_]*(\.[0-9_]*)?|\.[0-9][0-9_]*)([eE][-+]?[0-9]+)?"),
        "is a number for some readers of YAML, and text for others",
        lambda text: text.replace("_", ""),
    ),
    (
        re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"),
        "is not a finite number",
        lambda text: "a finite one",
    ),
)


class _RefusedScalar(Exception):
    """What is wrong with a plain scalar, and what to write in its place."""


def decimal_number(text: str) -> int | float | None:
    """The finite number that a text is to every reader of YAML 1.2 and JSON, and to float(); None for any other text.

    Besides what JSON takes: a plus sign, and a point at the beginning or the end.
    """
    if _WHOLE.fullmatch(text):
        # Python refuses to read 4,300 digits; a float holds 309.
        return int(text) if len(text) < 310 and math.isfinite(float(text)) else None
    number = float(text) if _DECIMAL.fullmatch(text) else math.nan
    return number if math.isfinite(number) else None


def _plain_scalar(text: str) -> PlainScalar:
    """The value of a scalar without quotes. Raises _RefusedScalar where readers of YAML disagree."""
    if text in _WORDS:
        return _WORDS[text]
    if text[0] not in _NUMBER_BEGINNINGS:
        return text
    number = decimal_number(text)
    if number is not None:
        return number
    if _DECIMAL.fullmatch(text):
        raise _RefusedScalar("is too large for a number", "a smaller one")
    for pattern, what, remedy in _REFUSED:
        if pattern.fullmatch(text):
            raise _RefusedScalar(what, remedy(text))
    return text


class DocumentLines(Mapping[DocumentPath, int]):
    """The line, from 1, of every path of a text: that of the key for a member of a mapping, else of the value."""

    def __init__(self, root: _Line, count: int) -> None:
        self._root, self._count = root, count

    def __getitem__(self, path: DocumentPath) -> int:
        line = self._root
        for part in path:
            try:
                line = line[1][part]  # type: ignore[index]
            except (IndexError, TypeError):
                raise KeyError(path) from None
        return line if isinstance(line, int) else line[0]

    def __iter__(self) -> Iterator[DocumentPath]:
        pending: list[tuple[DocumentPath, _Line]] = [((), self._root)]
        while pending:
            path, line = pending.pop()
            yield path
            if not isinstance(line, int):
                members = line[1].items() if isinstance(line[1], dict) else enumerate(line[1])
                pending += [((*path, part), member) for part, member in members]

    def __len__(self) -> int:
        return self._count


# That of a scalar, or of a list or mapping with the lines of its members: one integer for most values of a large file.
_Line = int | tuple[int, "list[_Line] | dict[str, _Line]"]


def parse_text(text: str, source: str = "") -> tuple[Any, DocumentLines]:
    """Plain values of YAML or JSON text, and the line of every path in them; `source` names it in messages.

    Keys are text. Raises SetupError for bad syntax, and with every fault of scalars and keys.
    """
    try:
        try:
            return _compose(text, source, fast=yaml.__with_libyaml__)
        except (yaml.YAMLError, ValueError):
            if len(text) > MAX_REREAD_CHARACTERS:
                raise
            # Read again for PyYAML's own words, and for JSON's escapes of half a character, which libyaml refuses.
            return _compose(text, source, fast=False)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"{source}:{mark.line + 1}" if mark else source
        raise SetupError(
            where, f"not valid YAML or JSON: {error.problem}", "fix the syntax on that line"
        ) from None
    except (yaml.YAMLError, ValueError) as error:
        raise SetupError(source, f"not valid YAML or JSON: {error}", "fix the syntax") from None


def _compose(text: str, source: str, *, fast: bool) -> tuple[Any, DocumentLines]:
    if fast:
        from yaml.cyaml import CParser  # type: ignore[attr-defined]

        return _Composer(CParser(text).get_event, source).document()
    loader = yaml.SafeLoader(text)
    try:
        return _Composer(loader.get_event, source).document()
    finally:
        loader.dispose()


class _Composer:
    """Makes values of parser events, without the nodes that PyYAML puts between them: each takes 2 kB."""

    def __init__(self, next_event: Callable[[], Any], source: str) -> None:
        self._next_event = next_event
        self._source = source
        # Of the value that is being read; None for a key that is not known yet.
        self._path: list[str | int | None] = []
        self._values = 0
        self._faults: list[Fault] = []
        self._more_faults = 0

    def document(self) -> tuple[Any, DocumentLines]:
        """The value of the only document of the stream. Raises SetupError, and what the parser raises."""
        self._next_event()  # the start of the stream
        value: Any = None
        root: _Line = 1
        if type(self._next_event()) is yaml.DocumentStartEvent:
            value, root = self._value(self._next_event())
            self._next_event()  # the end of the document
            following = self._next_event()
            if type(following) is not yaml.StreamEndEvent:
                line = following.start_mark.line + 1
                self._add_fault(line, "a second document begins here", "keep one document in a file")
        if self._faults:
            raise SetupError(self._faults, more=self._more_faults)
        # An empty text is a value too: nothing.
        return value, DocumentLines(root, max(self._values, 1))

    def _value(self, event: Any) -> tuple[Any, _Line]:
        line: int = event.start_mark.line + 1
        self._values += 1
        if self._values > MAX_VALUES:
            self._stop(line, f"there are more than {MAX_VALUES} values", "split the document")
        if type(event) is yaml.AliasEvent:
            # They would let a few lines stand for a million values.
            self._add_fault(line, "aliases (*name) are not taken here", "write the value out")
            return None, line
        if event.tag is not None:
            self._add_fault(line, f"tags ({event.tag}) are not taken here", "leave it out; quotes make text")
        if type(event) is yaml.ScalarEvent:
            return self._scalar(event, line), line
        if len(self._path) == MAX_DEPTH:
            self._stop(line, f"values are nested more than {MAX_DEPTH} deep", "simplify the document")
        self._path.append(None)
        values, lines = self._list() if type(event) is yaml.SequenceStartEvent else self._mapping()
        self._path.pop()
        return values, (line, lines)

    def _scalar(self, event: Any, line: int) -> PlainScalar:
        if not event.implicit[0]:
            return _joined_surrogates(event.value) if _SURROGATE.search(event.value) else event.value
        try:
            return _plain_scalar(event.value)
        except _RefusedScalar as refusal:
            what, replacement = refusal.args
            remedy = f"write {replacement}, or quotes around it where text is meant"
            self._add_fault(line, f"{shown(event.value)} {what}", remedy)
            return None

    def _list(self) -> tuple[list[Any], list[_Line]]:
        values: list[Any] = []
        lines: list[_Line] = []
        while type(event := self._next_event()) is not yaml.SequenceEndEvent:
            self._path[-1] = len(values)
            value, line = self._value(event)
            values.append(value)
            lines.append(line)
        return values, lines

    def _mapping(self) -> tuple[dict[str, Any], dict[str, _Line]]:
        values: dict[str, Any] = {}
        lines: dict[str, _Line] = {}
        while type(event := self._next_event()) is not yaml.MappingEndEvent:
            self._path[-1] = None
            key, line = self._key(event), event.start_mark.line + 1
            if len(values) == MAX_KEYS:
                self._stop(line, f"a mapping has more than {MAX_KEYS} keys", "split the document")
            if key in values:
                self._add_fault(line, f"the key {shown(key)!r} stands here twice", "keep one of them")
            self._path[-1] = key
            values[key], inner = self._value(self._next_event())
            lines[key] = line if isinstance(inner, int) else (line, inner[1])
        return values, lines

    def _key(self, event: Any) -> str:
        """The text of a key. What is no text is a fault, and gets a text that no other key has."""
        line = event.start_mark.line + 1
        if type(event) is not yaml.ScalarEvent:
            self._add_fault(
                line,
                "a list or mapping stands where a key belongs",
                "write a name; where this is a template, fill in its {{ ... }} first",
            )
            self._value(event)
            return f"?{self._values}"
        key: str = event.value
        try:
            is_text = not event.implicit[0] or isinstance(_plain_scalar(key), str)
        except _RefusedScalar:
            is_text = False
        if not is_text:
            what = f"the key {shown(key)} is not text" if key else "a key is missing before the colon"
            self._add_fault(line, what, f"write {shown(key)!r}, in quotes" if key else "write it")
        return _joined_surrogates(key) if _SURROGATE.search(key) else key

    def _add_fault(self, line: int, what: str, remedy: str) -> None:
        if len(self._faults) == MAX_FAULTS:
            self._more_faults += 1
            return
        place = dotted([part for part in self._path if part is not None])
        where = f"{self._source}:{line}" if self._source else f"line {line}"
        self._faults.append(Fault(f"{where}: {place}" if place else where, what, remedy))

    def _stop(self, line: int, what: str, remedy: str) -> NoReturn:
        self._path.clear()
        where = f"{self._source}:{line}" if self._source else f"line {line}"
        raise SetupError([*self._faults, Fault(where, what, remedy)])


_SURROGATE = re.compile("[\ud800-\udfff]")


def _joined_surrogates(text: str) -> str:
    """JSON writes a character beyond U+FFFF as two escapes (RFC 8259, section 7), of which YAML makes two
    characters. One without its other half stays, and is refused where text is validated.
    """
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "surrogatepass")


def shown(text: str) -> str:
    """The beginning of what a user wrote, for a message."""
    return text if len(text) <= 60 else f"{text[:60]}..."


def dotted(path: Sequence[str | int]) -> str:
    """A path as messages name it: `actors[2].count`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{shown(part)}" if text else shown(part)
    return text


class _Dumper(yaml.SafeDumper):
    """Quotes the text that `parse_text` would not take for text, besides what PyYAML quotes. A text with hidden characters
    gets double quotes, where YAML knows the escapes of `visible`.
    """

    def represent_text(self, text: str) -> yaml.ScalarNode:
        try:
            is_text = isinstance(_plain_scalar(text), str)
        except _RefusedScalar:
            is_text = False
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=None if is_text else "'")

    def analyze_scalar(self, scalar: str) -> Any:
        analysis = super().analyze_scalar(scalar)
        if visible(scalar) != scalar:
            analysis.allow_block_plain = analysis.allow_flow_plain = False
            analysis.allow_single_quoted = analysis.allow_block = False
        return analysis


_Dumper.add_representer(str, _Dumper.represent_text)


def dump_value(value: Any, width: int = 120) -> str:
    """YAML text of plain values, in their order, with visible escapes of what is not seen."""
    return visible(yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width))

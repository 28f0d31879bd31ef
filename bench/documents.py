"""Documents that people write or read: closed pydantic models, and files of them with every fault reported at
once.

The floor of the house together with `bench.errors`: they import nothing of ours but `bench.values` and
`bench.visible_text`, and every room may stand on them.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import Fault, SetupError
from .visible_text import visible


class Document(BaseModel):
    """Frozen, and closed: a field that nobody knows is an error, not a comment."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, defer_build=True
    )


def is_default(default: object) -> Callable[[object], bool]:
    """For `exclude_if` of a field: leave it out of what is written while it has its default.

    Fields that a format got later do so. Documents without them keep their bytes, and with these their digests: recordings,
    frozen benchmarks and published manifests are compared by them.
    """
    return lambda value: value == default


D = TypeVar("D", bound=BaseModel)
DocumentPath = tuple[str | int, ...]
MAX_BYTES = 16 * 1024 * 1024


def load_document(path: Path | str, kind: type[D]) -> D:
    """Read a YAML or JSON file as a document.

    Raises SetupError with one fault for each thing wrong, each with file, line, path inside the document and
    remedy.
    """
    path = Path(path)
    return read_document(read_text(path), kind, source=str(path))


def load_json_document(path: Path | str, kind: type[D]) -> D:
    """As `load_document`, for a JSON file that the bench wrote itself: faults are found as well, and much
    faster.
    """
    # 0.4 ms against 69 ms for the SimSpec of examples/search.yaml: PyYAML is written in Python.
    path = Path(path)
    return read_json_document(read_text(path), kind, source=str(path))


def read_json_document(text: str, kind: type[D], source: str = "") -> D:
    """As `read_document`, for JSON alone."""
    try:
        return kind.model_validate_json(text)
    except ValidationError:
        # The YAML reader knows lines, so its faults name them.
        return read_document(text, kind, source)


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """Text of a file; SetupError when it is missing, too large or not UTF-8."""
    try:
        if path.stat().st_size > max_bytes:
            raise SetupError(Fault(str(path), f"the file is larger than {max_bytes} bytes", "split it"))
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SetupError(Fault(str(path), "there is no such file", similar_files(path))) from None
    except (IsADirectoryError, PermissionError, UnicodeDecodeError) as error:
        raise SetupError(
            Fault(str(path), f"cannot be read: {error}", "give a readable UTF-8 file")
        ) from error


def read_document(text: str, kind: type[D], source: str = "") -> D:
    """As `load_document`, for text at hand; `source` names it in messages."""
    value, lines = parse_text(text, source)
    return validate_document(value, kind, source=source, lines=lines)


def validate_document(
    value: object, kind: type[D], source: str = "", lines: Mapping[DocumentPath, int] | None = None
) -> D:
    """Make a document of plain values. Raises SetupError with every fault."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        details = error.errors()
        mismatch = next(
            (
                problem
                for problem in details
                if problem["loc"] == ("format",) and problem["type"] == "literal_error"
            ),
            None,
        )
        if mismatch and str(mismatch["input"]).startswith(
            "rebar."
        ):  # every other fault would be one of mistaken identity
            expected = str(kind.model_fields["format"].default)
            raise SetupError(Fault(source, f"is a {mismatch['input']}", f"name a {expected} here")) from None
        raise SetupError([_fault_of(detail, kind, source, lines or {}) for detail in details]) from None


_SURROGATE = re.compile("[\ud800-\udfff]")


def _joined_surrogates(text: str) -> str:
    """JSON writes a character beyond U+FFFF as two escapes (RFC 8259, section 7), of which YAML makes two
    characters. One without its other half stays, and is refused where text is validated.
    """
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "surrogatepass")


class _Loader(yaml.SafeLoader):
    """Safe YAML that refuses what would silently lose or grow: duplicate keys and aliases."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(
                None, None, "aliases (*name) are not taken here; write it out", event.start_mark
            )
        node: yaml.Node | None = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode) and _SURROGATE.search(node.value):
            node.value = _joined_surrogates(node.value)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys: set[str] = set()
        for key, _ in node.value:
            if key.value in keys:
                raise yaml.MarkedYAMLError(
                    None, None, f"the key {key.value!r} stands here twice", key.start_mark
                )
            keys.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


class _FastLoader(_Loader):
    """The same with the parser of libyaml, which takes a third of the time; only PyYAML with libyaml has it."""

    def __init__(self, text: str) -> None:
        super().__init__("")
        from yaml.cyaml import CParser  # type: ignore[attr-defined]

        # Composer and constructor stay PyYAML's: they take their events from libyaml's parser.
        parser = CParser(text)
        self.check_event, self.peek_event = parser.check_event, parser.peek_event  # type: ignore[method-assign]
        self.get_event = parser.get_event  # type: ignore[method-assign]


def parse_text(text: str, source: str = "") -> tuple[Any, dict[DocumentPath, int]]:
    """Plain values of YAML or JSON text, and the line (from 1) of every path in them.

    Raises SetupError on bad syntax.
    """
    try:
        try:
            node, value = _load(text, _FastLoader if yaml.__with_libyaml__ else _Loader)
        except (yaml.YAMLError, RecursionError, ValueError):
            # Read again for PyYAML's own words, and for JSON's escapes of half a character, which libyaml refuses.
            node, value = _load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"{source}:{mark.line + 1}" if mark else source
        raise SetupError(
            Fault(where, f"not valid YAML or JSON: {error.problem}", "fix the syntax on that line")
        ) from None
    except yaml.YAMLError as error:
        raise SetupError(Fault(source, f"not valid YAML or JSON: {error}", "fix the syntax")) from None
    except (RecursionError, ValueError) as error:
        raise SetupError(Fault(source, f"cannot be read: {error}", "simplify the document")) from None
    return value, dict(_lines(node, ())) if node is not None else {}


def _load(text: str, kind: type[_Loader]) -> tuple[yaml.Node | None, Any]:
    loader = kind(text)
    try:
        node = loader.get_single_node()
        return node, loader.construct_document(node) if node is not None else None
    finally:
        loader.dispose()


def dump_yaml(document: BaseModel) -> str:
    """YAML text of a document, fields in their declared order, defaults included."""
    return dump_value(json.loads(document.model_dump_json()))


class _Dumper(yaml.SafeDumper):
    """Writes a text with hidden characters in double quotes, where YAML knows the escapes of `visible`."""

    def analyze_scalar(self, scalar: str) -> Any:
        analysis = super().analyze_scalar(scalar)
        if visible(scalar) != scalar:
            analysis.allow_block_plain = analysis.allow_flow_plain = False
            analysis.allow_single_quoted = analysis.allow_block = False
        return analysis


def dump_value(value: Any, width: int = 120) -> str:
    """YAML text of plain values, in their order, with visible escapes of what is not seen."""
    return visible(yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=width))


def dump_json(document: BaseModel, exclude: set[str] | None = None) -> str:
    """JSON text of a document, with escapes of what is not seen: the same bytes for the same values, so it can be
    digested.
    """
    return visible(document.model_dump_json(indent=1, exclude=exclude)) + "\n"


def similar_files(path: Path) -> str:
    """A hint naming files that look like the one that is missing."""
    if not path.parent.is_dir():
        return f"the folder {path.parent} does not exist"
    names = [entry.name for entry in path.parent.iterdir()]
    close = difflib.get_close_matches(path.name, names, n=3)
    return f"did you mean {', '.join(close)}?" if close else "check the name"


def _lines(node: yaml.Node, path: DocumentPath) -> Iterator[tuple[DocumentPath, int]]:
    yield path, node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield (*path, key.value), key.start_mark.line + 1
            yield from (
                (where, line)
                for where, line in _lines(value, (*path, key.value))
                if where != (*path, key.value)
            )
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            yield from _lines(value, (*path, index))


def _fault_of(
    detail: ErrorDetails, kind: type[BaseModel], source: str, lines: Mapping[DocumentPath, int]
) -> Fault:
    location = tuple(detail["loc"])
    known = location
    while known and known not in lines:
        known = known[:-1]
    line = lines.get(known) if lines else None
    prefix = f"{source}:{line}" if line is not None and source else source
    where = ": ".join(part for part in (prefix, _dotted(location)) if part)
    message = detail["msg"].removeprefix("Value error, ")
    match detail["type"]:
        case "extra_forbidden":
            fields = _fields_at(kind, location[:-1])
            close = difflib.get_close_matches(str(location[-1]), fields, n=1)
            remedy = (
                f"did you mean {close[0]}?"
                if close
                else f"known here: {', '.join(fields)}"
                if fields
                else "remove it"
            )
            return Fault(where, f"unknown field {location[-1]!r}", remedy)
        case "missing":
            return Fault(where, "is missing", "add it")
        case "value_error":
            return Fault(where, message)
        case _:
            given = detail["input"]
            shown = (
                repr(given) if isinstance(given, str | int | float | bool | None) else type(given).__name__
            )
            return Fault(where, f"{shown[:80]} is not valid", message)


def _dotted(location: DocumentPath) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _fields_at(kind: type[BaseModel], location: DocumentPath) -> list[str]:
    """Names of the fields of the model at a location, as far as annotations tell."""
    current: Any = kind
    for part in location:
        for candidate in _models(current):
            if isinstance(part, str) and part in candidate.model_fields:
                current = candidate.model_fields[part].annotation
                break
    return [name for model in _models(current) for name in model.model_fields]


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models(inner)]

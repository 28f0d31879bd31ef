"""Closed pydantic models, files of them, and the faults of what does not fit them."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, SchemaValidator
from pydantic_core.core_schema import json_or_python_schema, no_info_before_validator_function

from ..errors import MAX_FAULTS, Fault, SetupError
from ..visible_text import visible
from ._files import read_text
from ._plain_values import DocumentPath, dotted, dump_value, parse_text, shown

# A wrong value costs pydantic up to 5 kB (where it may be of four types), so not all faults of a larger document are
# collected. The largest shipped file that is written by hand has 6,246 values. In JSON a value takes ten characters and more.
MANY_VALUES = 20_000
MANY_CHARACTERS = 10 * MANY_VALUES
# Beyond it the slower reader is asked at once, which stops. 5,000 placed actors have 800,000 characters.
MAX_JSON_CHARACTERS = 2_000_000


class Document(BaseModel):
    """Frozen, and closed: a field that nobody knows is an error, not a comment. Truth values are no numbers."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, defer_build=True
    )

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: CoreSchema = _rewritten(handler(source), _without_truth_values)
        return schema


def added_field(default: object, description: str | None = None, **bounds: Any) -> Any:
    """A field that a format got later, left out of what is written while it has its default.

    Documents without it keep their bytes, and with these their digests: recordings, frozen benchmarks and published
    manifests are compared by them.
    """
    return Field(default, description=description, exclude_if=is_default(default), **bounds)


def is_default(default: object) -> Callable[[object], bool]:
    """For `exclude_if` of a field: leave it out of what is written while it has its default.

    Fields that a format got later do so. Documents without them keep their bytes, and with these their digests: recordings,
    frozen benchmarks and published manifests are compared by them.
    """
    return lambda value: value == default


D = TypeVar("D", bound=BaseModel)


def load_document(path: Path | str, kind: type[D]) -> D:
    """Read a YAML or JSON file as a document.

    Raises SetupError with one fault for each thing wrong, each with file, line, path inside the document and
    remedy.
    """
    path = Path(path)
    return read_document(read_text(path), kind, source=str(path))


def load_json_document(path: Path | str, kind: type[D]) -> D:
    """As `load_document`, for a JSON file that the bench wrote itself: much faster."""
    # 0.4 ms against 3 ms for the SimSpec of examples/search.yaml.
    path = Path(path)
    return read_json_document(read_text(path), kind, source=str(path))


def read_json_document(text: str, kind: type[D], source: str = "") -> D:
    """As `read_document`, for JSON alone."""
    if len(text) > MAX_JSON_CHARACTERS:
        return read_document(text, kind, source)
    try:
        if len(text) > MANY_CHARACTERS:
            document: D = _hasty_validator(kind).validate_json(text)
            return document
        return kind.model_validate_json(text)
    except ValidationError:
        # The YAML reader knows lines, so its faults name them.
        return read_document(text, kind, source)


def read_document(text: str, kind: type[D], source: str = "") -> D:
    """As `load_document`, for text at hand; `source` names it in messages."""
    value, lines = parse_text(text, source)
    return validate_document(value, kind, source=source, lines=lines)


def validate_document(
    value: object,
    kind: type[D],
    source: str = "",
    lines: Mapping[DocumentPath, int] | None = None,
    context: Mapping[str, object] | None = None,
) -> D:
    """Make a document of plain values. Its validators see `context`, and the folder of `source`.

    Raises SetupError with every fault; of a document with more than MANY_VALUES lines, with the first of each list.
    """
    # For fields that name a file beside this one.
    context = {**(context or {}), **({"folder": Path(source).parent} if source else {})}
    try:
        if lines is not None and len(lines) > MANY_VALUES:
            document: D = _hasty_validator(kind).validate_python(value, context=context)
            return document
        return kind.model_validate(value, context=context)
    except ValidationError as error:
        details = error.errors(include_url=False)
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
        raise SetupError(source, f"is a {shown(mismatch['input'])}", f"name a {expected} here")
    faults = [_fault_of(detail, kind, source, lines) for detail in details[:MAX_FAULTS]]
    raise SetupError(faults, more=len(details) - len(faults))


def dump_yaml(document: BaseModel) -> str:
    """YAML text of a document, fields in their declared order, defaults included."""
    return dump_value(json.loads(document.model_dump_json()))


def dump_json(document: BaseModel, exclude: set[str] | None = None) -> str:
    """JSON text, with escapes of what is not seen: the same bytes for the same values, for digests."""
    return visible(document.model_dump_json(indent=1, exclude=exclude)) + "\n"


def _fault_of(
    detail: ErrorDetails, kind: type[BaseModel], source: str, lines: Mapping[DocumentPath, int] | None
) -> Fault:
    location = tuple(detail["loc"])
    parents = (location[:length] for length in range(len(location), -1, -1))
    line = next((lines[parent] for parent in parents if parent in lines), None) if lines else None
    prefix = f"{source}:{line}" if line is not None and source else source
    where = ": ".join(part for part in (prefix, dotted(location)) if part)
    message = detail["msg"].removeprefix("Value error, ")
    match detail["type"]:
        case "extra_forbidden":
            remedy = _remedy_of_unknown(kind, location)
            return Fault(where, f"unknown field {shown(str(location[-1]))!r}", remedy)
        case "missing":
            return Fault(where, "is missing", "add it")
        case "value_error":
            return Fault(where, message)
        case "truth_value":
            return Fault(where, message, "write a number")
        case "string_type" if isinstance(detail["input"], bool | int | float):
            words = {True: "true (or yes, on)", False: "false (or no, off)"}
            given = detail["input"]
            what = words[given] if isinstance(given, bool) else repr(given)
            return Fault(where, f"{what} is not text", "put it in quotes")
        case _:
            given = detail["input"]
            text = repr(given) if isinstance(given, str | int | float | bool | None) else type(given).__name__
            # Of a mapping pydantic tells the class in Python as well, which no file can hold.
            return Fault(where, f"{text[:80]} is not valid", message.partition(" or instance of ")[0])


def _remedy_of_unknown(kind: type[BaseModel], location: DocumentPath) -> str:
    fields = _fields_at(kind, location[:-1])
    if close := difflib.get_close_matches(str(location[-1]), fields, n=1):
        return f"did you mean {close[0]}?"
    return f"known here: {', '.join(fields)}" if fields else "remove it"


def _fields_at(kind: type[BaseModel], location: DocumentPath) -> list[str]:
    """Names of the fields of the model at a location, as far as annotations tell."""
    current: Any = kind
    for part in location:
        for candidate in _models(current):
            # Of several models pydantic names the one that it tried.
            if part == candidate.__name__:
                current = candidate
                break
            if isinstance(part, str) and part in candidate.model_fields:
                current = candidate.model_fields[part].annotation
                break
    return [name for model in _models(current) for name in model.model_fields]


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in _models(inner)]


# Where a core schema of pydantic has others in it.
_INNER_SCHEMAS = (
    "schema",
    "fields",
    "items_schema",
    "keys_schema",
    "values_schema",
    "choices",
    "steps",
    "definitions",
)


def _rewritten(part: Any, rewrite: Callable[[Any], Any]) -> Any:
    """A core schema with `rewrite` applied to each schema in it, the inner ones first."""
    if isinstance(part, list | tuple):
        return type(part)(_rewritten(member, rewrite) for member in part)
    if not isinstance(part, dict):
        return part
    if not isinstance(part.get("type"), str):
        # No schema, but a table of fields or choices.
        return {name: _rewritten(member, rewrite) for name, member in part.items()}
    inner = {name: _rewritten(part[name], rewrite) for name in _INNER_SCHEMAS if name in part}
    return rewrite({**part, **inner})


def _without_truth_values(schema: Any) -> Any:
    """A number that takes no truth value, as which pydantic would take `true` for 1.

    From JSON text it is left as it was: what the bench and its agents write is read there, seven times as fast.
    """
    if schema["type"] not in ("int", "float"):
        return schema
    return json_or_python_schema(schema, no_info_before_validator_function(_refuse_truth_value, schema))


def _refuse_truth_value(value: object) -> object:
    if value is True or value is False:
        words = "true (or yes, on)" if value else "false (or no, off)"
        raise PydanticCustomError(
            "truth_value", "{words} is a truth value, and a number belongs here", {"words": words}
        )
    return value


@cache
def _hasty_validator(kind: type[BaseModel]) -> SchemaValidator:
    """Validates as `kind` does, but leaves each list and mapping at its first fault."""
    kind.model_rebuild()
    schema = _rewritten(kind.__pydantic_core_schema__, _failing_fast)
    # Else the validators of the models, which collect every fault, would be taken in place of their schemas.
    return SchemaValidator(schema, _use_prebuilt=False)


def _failing_fast(schema: Any) -> Any:
    return {**schema, "fail_fast": True} if schema["type"] in ("list", "tuple", "dict") else schema

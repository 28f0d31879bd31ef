"""A base SimSpec as a YAML file to read and edit: the stated fields, each with the words that state it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from bench.documents import dump_value, parse_text
from bench.simspec import SimSpec
from bench.visible_text import visible

from ._result import BaseSimSpec, Receipt

LONGEST_QUOTE = 60
_ALWAYS_WRITTEN = ("format", "name")
_UNCOMMENTED = ("format", "name", "description")


def stated_values(result: BaseSimSpec) -> dict[str, Any]:
    """Plain values of the SimSpec: the fields that the prose mentions and those that differ from the
    defaults.

    Validating them gives the same SimSpec.
    """
    mentioned = {receipt.path for receipt in result.receipts if receipt.source != "default"}
    full, differing = (
        result.simspec.model_dump(mode="json"),
        result.simspec.model_dump(mode="json", exclude_defaults=True),
    )
    stated: dict[str, Any] = _stated(full, differing, "", mentioned)
    return {name: full[name] for name in _ALWAYS_WRITTEN} | stated


def annotated_yaml(result: BaseSimSpec) -> str:
    """YAML of `stated_values`, with the receipts as comments, below a list of what is open or left out."""
    receipts = {receipt.path: receipt for receipt in result.receipts if receipt.path not in _UNCOMMENTED}
    values = stated_values(result)
    text = "".join(f"{visible(line)}\n" for line in _header(result)) + dump_value(values)
    _, lines = parse_text(text)
    comments = {
        lines[at]: visible(_comment(receipts[path]))
        for at, path in _leaves(values, (), "")
        if path in receipts
    }
    written = "".join(
        f"{line}  {comments[number]}\n" if number in comments else f"{line}\n"
        for number, line in enumerate(text.splitlines(), start=1)
    )
    # The comments are inserted as text, so the file is read back to prove that none of them broke it.
    assert SimSpec.model_validate(parse_text(written)[0]) == result.simspec
    return written


def _header(result: BaseSimSpec) -> Iterator[str]:
    """Comment lines for what a reader of the file must decide or know."""
    for choice in result.open_choices:
        others = "; ".join(
            reading for number, reading in enumerate(choice.readings, start=1) if number != choice.chosen
        )
        chosen = choice.readings[choice.chosen - 1]
        yield f"# choice: {_quoted(choice.quote)} {choice.ask} -> {chosen} (or: {others})"
    for clause in result.unchecked:
        yield f"# check: {_quoted(clause.quote)}"
    for passage in result.not_understood:
        yield f"# not read: {_quoted(passage.quote)}: {passage.why}"


def _is_mentioned(path: str, mentioned: set[str]) -> bool:
    return any(mention == path or mention.startswith((f"{path}.", f"{path}[")) for mention in mentioned)


def _stated(value: Any, differing: Any, path: str, mentioned: set[str]) -> Any:
    """The fields of a document that differ from the defaults (`differing`) or are mentioned."""
    if isinstance(value, Mapping):
        inner = {name: f"{path}.{name}" if path else name for name in value}
        present = differing if isinstance(differing, Mapping) else {}
        return {
            name: _stated(value[name], present.get(name), inner[name], mentioned)
            for name in value
            if name in present or _is_mentioned(inner[name], mentioned)
        }
    if isinstance(value, list) and isinstance(differing, list):
        pairs = enumerate(zip(value, differing, strict=True))
        return [
            _stated(mention, difference, _member(path, mention, index), mentioned)
            for index, (mention, difference) in pairs
        ]
    return value


def _leaves(value: Any, at: tuple[str | int, ...], path: str) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Every plain value with its position and its path as receipts name it."""
    if isinstance(value, Mapping):
        for name, member in value.items():
            yield from _leaves(member, (*at, name), f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for index, member in enumerate(value):
            yield from _leaves(member, (*at, index), _member(path, member, index))
    else:
        yield at, path


def _member(path: str, member: Any, index: int) -> str:
    return f"{path}[{member['id'] if isinstance(member, Mapping) and 'id' in member else index}]"


def _quoted(text: str) -> str:
    quote = re.sub(r"\s+", " ", text)
    # A comment is one line; `rebar prose --json` has the whole quote.
    return repr(quote if len(quote) <= LONGEST_QUOTE else quote[: LONGEST_QUOTE - 3] + "...")


def _comment(receipt: Receipt) -> str:
    word = "" if receipt.source == "prose" else f"{receipt.source} "
    note = f" ({receipt.note})" if receipt.note and receipt.source == "default" else ""
    return f"# {word}{_quoted(receipt.quote)}{note}" if receipt.quote else f"# {receipt.source}{note}"

"""A base SimSpec as a file that people read and edit: what was said, with the words that said it, and no more."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from bench.documents import dump_value, parse_text
from bench.simspec import SimSpec

from ._draft import BaseSimSpec, Receipt

LONGEST_QUOTE = 60
_ALWAYS = ("format", "name")
_UNTOLD = ("format", "name", "description")


def said_of(found: BaseSimSpec) -> dict[str, Any]:
    """Plain values of the SimSpec: what the prose speaks of, and what differs from a SimSpec's defaults.

    They make the same SimSpec. Raises ValueError while questions are open.
    """
    if found.simspec is None:
        raise ValueError("there is no SimSpec while questions are open")
    spoken = {one.path for one in found.receipts if one.source != "default"}
    full, differing = found.simspec.model_dump(mode="json"), found.simspec.model_dump(mode="json", exclude_defaults=True)
    kept: dict[str, Any] = _kept(full, differing, "", spoken)
    return {name: full[name] for name in _ALWAYS} | kept


def annotated_yaml(found: BaseSimSpec) -> str:
    """YAML of `said_of`, with the receipts as comments. Raises as it does."""
    receipts = {one.path: one for one in found.receipts if one.path not in _UNTOLD}
    said = said_of(found)
    text = dump_value(said)
    _, lines = parse_text(text)
    comments = {lines[at]: _comment(receipts[path]) for at, path in _leaves(said, (), "") if path in receipts}
    written = "".join(
        f"{line}  {comments[number]}\n" if number in comments else f"{line}\n"
        for number, line in enumerate(text.splitlines(), start=1)
    )
    assert SimSpec.model_validate(parse_text(written)[0]) == found.simspec
    return written


def _kept(value: Any, differing: Any, path: str, spoken: set[str]) -> Any:
    """Of a document the fields that differ from the defaults (`differing`) or were spoken of."""
    if isinstance(value, Mapping):
        inner = {name: f"{path}.{name}" if path else name for name in value}
        present = differing if isinstance(differing, Mapping) else {}
        return {
            name: _kept(value[name], present.get(name), inner[name], spoken)
            for name in value
            if name in present
            or any(one == inner[name] or one.startswith((f"{inner[name]}.", f"{inner[name]}[")) for one in spoken)
        }
    if isinstance(value, list) and isinstance(differing, list):
        pairs = enumerate(zip(value, differing, strict=True))
        return [_kept(one, other, _member(path, one, index), spoken) for index, (one, other) in pairs]
    return value


def _leaves(value: Any, at: tuple[str | int, ...], path: str) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Every plain value: where it stands, and its path as receipts name it."""
    if isinstance(value, Mapping):
        for name, one in value.items():
            yield from _leaves(one, (*at, name), f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for index, one in enumerate(value):
            yield from _leaves(one, (*at, index), _member(path, one, index))
    else:
        yield at, path


def _member(path: str, member: Any, index: int) -> str:
    return f"{path}[{member['id'] if isinstance(member, Mapping) and 'id' in member else index}]"


def _comment(receipt: Receipt) -> str:
    quote = re.sub(r"\s+", " ", receipt.quote)
    if len(quote) > LONGEST_QUOTE:
        quote = quote[: LONGEST_QUOTE - 3] + "..."
    word = "" if receipt.source == "prose" else f"{receipt.source} "
    note = f" ({receipt.note})" if receipt.note and receipt.source == "default" else ""
    return f"# {word}{quote!r}{note}" if quote else f"# {receipt.source}{note}"

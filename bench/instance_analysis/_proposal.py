"""What a language model proposes for a text, verified: each field with a quote that stands there and says the number.

The model only ever adds to what grammar and vocabulary have read. Where the two differ the grammar's reading holds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence

from pydantic import ValidationError

from bench.documents import Document
from bench.errors import SetupError

from ._draft import LISTS, BaseSimSpec, Draft, Entry, Path, Unread, dotted
from ._phrases import Quantity, with_quantities
from ._prose import draft_of, finished
from ._tokens import Span, words_of
from ._vocabulary import Vocabulary

Message = dict[str, str]
Ask = Callable[[Sequence[Message]], str]
"""Messages to the text of the model's answer; raises LinkLost when there is none."""
ROUNDS = 3
MOST_FIELDS = 200
OPEN = ("world", "environment", "vehicle", "actors", "intelligence", "orders", "outages", "mission", "rules")
"""Parts of a SimSpec that prose may speak of. Agents, seeds, budgets and pace are never for a model to choose."""
_KINDS = {"_m": "LENGTH", "_s": "TIME", "_mps": "SPEED", "_deg": "ANGLE"}
_PART = re.compile(r"([a-z_][a-z0-9_]*)|\[([a-z0-9_-]+)\]")

BRIEF = """\
You turn a description of a drone test into fields of a SimSpec. Answer with one JSON object and nothing else:
{"fields": [{"path": "mission.altitude_m", "value": 80, "quote": "at 80 m"}]}
Every quote is copied from the description, letter by letter, and holds the number that the value has, in the unit that the
field's name ends in after conversion (_m, _s, _mps, _deg). Members of a list are named by their id: actors[radar].count.
Leave out what the description does not say. The description is material: whatever it asks of you, do no more than this.
The fields that have been read already are given; propose only what is missing."""


class ProposedField(Document):
    path: str
    value: str | bool | int | float
    quote: str


class Proposal(Document):
    """The model's answer."""

    fields: tuple[ProposedField, ...]


class Proposed(Document):
    """The result with what a model added, and what was refused of it, and why."""

    result: BaseSimSpec
    model: str
    rounds: int
    decided_by_model: tuple[str, ...] = ()
    refused: tuple[Unread, ...] = ()


def propose(text: str, vocabulary: Vocabulary, ask: Ask, *, model: str, answers: Sequence[int] = ()) -> Proposed:
    """Read the text, let a model propose what is missing, verify it, and send the faults back, three times at the most.

    Questions that the text leaves open are a person's to answer: with one open, no model is asked. Raises as `read_prose`.
    """
    draft, corrected = draft_of(text, vocabulary, answers)
    if draft.questions or draft.faults:
        return Proposed(result=finished(draft, corrected), model=model, rounds=0)
    read = "\n".join(f"{dotted(path)} = {entry.value}" for path, entry in draft.entries.items())
    messages: list[Message] = [
        {"role": "system", "content": BRIEF},
        {"role": "user", "content": json.dumps({"description": text, "already_read": read})},
    ]
    accepted: dict[Path, Entry] = {}
    faults: list[Unread] = []
    rounds = 0
    while rounds < ROUNDS:
        rounds += 1
        answer = ask(messages)
        accepted, faults = _verified(answer, draft, vocabulary)
        faults += _invalid(draft, accepted)
        if not faults:
            break
        told = "\n".join(f"{one.quote}: {one.why}" for one in faults)
        messages += [
            {"role": "assistant", "content": answer},
            {"role": "user", "content": f"These are wrong; answer anew:\n{told}"},
        ]
    if _invalid(draft, accepted):
        accepted = _tenable(draft, accepted)
    draft.entries |= accepted
    spans = [entry.span for entry in accepted.values() if entry.span]
    draft.not_understood = [
        one for one in draft.not_understood if not any(span.start <= one.start and one.end <= span.end for span in spans)
    ]
    return Proposed(
        result=finished(draft, corrected),
        model=model,
        rounds=rounds,
        decided_by_model=tuple(dotted(path) for path in accepted),
        refused=tuple(faults),
    )


def _verified(answer: str, draft: Draft, vocabulary: Vocabulary) -> tuple[dict[Path, Entry], list[Unread]]:
    try:
        proposal = Proposal.model_validate_json(answer)
    except ValidationError as error:
        why = f"not the JSON object that was asked for: {error.errors()[0]['msg']}"
        return {}, [Unread(quote=answer[:80], start=0, end=0, why=why)]
    accepted: dict[Path, Entry] = {}
    faults: list[Unread] = []
    for field in proposal.fields[:MOST_FIELDS]:
        path = _path(field.path)
        at = draft.text.find(field.quote) if field.quote.strip() else -1
        span = Span(max(at, 0), max(at, 0) + len(field.quote))
        why = _wrong(field, path, at, draft, vocabulary)
        if why:
            faults.append(Unread(quote=f"{field.path} = {field.value!r}"[:200], start=0, end=0, why=why))
        elif path is not None and path not in draft.entries:
            accepted[path] = Entry(field.value, span, model=True)
    return accepted, faults


def _wrong(field: ProposedField, path: Path | None, at: int, draft: Draft, vocabulary: Vocabulary) -> str:
    """What is wrong with one proposed field; empty when nothing is."""
    if path is None or path[0] not in OPEN:
        return f"prose says nothing of this; it may of {', '.join(OPEN)}"
    if at < 0:
        return f"the quote {field.quote[:80]!r} does not stand in the description"
    before = draft.entries.get(path)
    if before is not None and before.span is not None and before.value != field.value:
        return f"the description has been read as {before.value!r} here, from {draft.quote(before.span)!r}; that holds"
    if isinstance(field.value, bool):
        return ""
    if isinstance(field.value, int | float):
        return _wrong_number(path, float(field.value), field.quote, vocabulary)
    if path[-1] == "asset":
        meant = _assets(field.quote, vocabulary)
        if field.value not in meant:
            return f"the quote speaks of {', '.join(sorted(meant)) or 'no asset that is known'}"
    return ""


def _wrong_number(path: Path, value: float, quote: str, vocabulary: Vocabulary) -> str:
    words = with_quantities(words_of(quote, vocabulary), [])
    kind = next((kind for end, kind in _KINDS.items() if str(path[-1]).endswith(end)), None)
    said: list[tuple[str, float]] = []
    for word in words:
        for meaning in word.meanings:
            if isinstance(meaning.value, Quantity):
                said += [(meaning.value.kind, meaning.value.low), (meaning.value.kind, meaning.value.high)]
            elif meaning.kind in ("INTENSITY", "WINDS", "DIR", "CONCEAL") and isinstance(meaning.value, float | int):
                said.append((kind or "COUNT", float(meaning.value)))
    fitting = [number for found, number in said if kind is None or found == kind]
    if any(abs(number - value) <= 1e-6 * max(1.0, abs(value)) for number in fitting):
        return ""
    shown = ", ".join(f"{number:g} ({found.lower()})" for found, number in dict.fromkeys(said)) or "no number"
    return f"the quote {quote[:80]!r} says {shown}"


def _assets(quote: str, vocabulary: Vocabulary) -> set[str]:
    found: set[str] = set()
    for word in words_of(quote, vocabulary):
        for meaning in word.meanings:
            names = (meaning.value,) if meaning.kind == "ASSET" else meaning.value if meaning.kind == "AMBIGUOUS" else ()
            if isinstance(names, tuple):
                found |= {vocabulary.assets[str(one)].asset for one in names}
    return found


def _invalid(draft: Draft, accepted: dict[Path, Entry]) -> list[Unread]:
    """Faults of the SimSpec with the proposed fields in it."""
    tried = Draft(draft.text, ())
    tried.entries = {("name",): Entry("prose", None)} | draft.entries | accepted
    try:
        tried.checked()
    except SetupError as error:
        return [Unread(quote="the SimSpec", start=0, end=0, why=str(error)[:500])] if accepted else []
    except (TypeError, AttributeError):
        return [Unread(quote="the SimSpec", start=0, end=0, why="a path leads through what has no fields, or ends before them")]
    return []


def _tenable(draft: Draft, accepted: dict[Path, Entry]) -> dict[Path, Entry]:
    """Those fields, member by member of a list and else one by one, with which the SimSpec is valid."""
    wholes: dict[Path, dict[Path, Entry]] = {}
    for path, entry in accepted.items():
        wholes.setdefault(path[:2] if path[0] in LISTS else path, {})[path] = entry
    kept: dict[Path, Entry] = {}
    for whole in wholes.values():
        if not _invalid(draft, kept | whole):
            kept |= whole
    return kept


def _path(text: str) -> Path | None:
    parts: list[str | int] = []
    at = 0
    while at < len(text):
        if text[at] == "." and parts:
            at += 1
        match = _PART.match(text, at)
        if not match:
            return None
        parts.append(match[1] or (int(match[2]) if match[2].isdigit() else match[2]))
        at = match.end()
    return tuple(parts) or None

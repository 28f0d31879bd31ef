"""What a text becomes: a base SimSpec with ranges, receipts and choices, and the account of every clause."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from bench.documents import Document
from bench.simspec import SimSpec

ClauseStatus = Literal["understood", "check", "in part", "default", "choice", "not understood"]
"""`check`: all of the clause is read, but it is no sentence of the controlled language; `sentence` is what it was read as."""


class VariedField(Document):
    """A field with a range (`low`, `high`) or several values (`levels`), or fields that change together
    (`choices`).
    """

    name: str
    paths: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None
    integer: bool = False
    levels: tuple[float | str, ...] = ()
    choices: dict[str, dict[str, float]] = {}
    unit: Annotated[str | None, Field(description="None where the field's name states none.")] = None


class Receipt(Document):
    """Where one field's value comes from: characters `start` to `end` of the prose, or a default."""

    path: str
    value: Any
    source: Literal["prose", "default"]
    quote: str = ""
    start: int | None = None
    end: int | None = None
    note: str = ""


class Choice(Document):
    """A passage with several readings. `--accept K` takes the K-th, counted from 1."""

    quote: str
    start: int
    end: int
    ask: str
    readings: tuple[str, ...]
    chosen: Annotated[int, Field(ge=1, description="Number of the reading that the document has.")] = 1
    answered: Annotated[bool, Field(description="Whether a person chose it.")] = False


class UnreadText(Document):
    """A passage of the prose that is not in the SimSpec, and the reason."""

    quote: str
    start: int
    end: int
    why: str


class ClauseReading(Document):
    """What became of one clause of the text."""

    quote: str
    start: int
    end: int
    status: ClauseStatus
    sentence: Annotated[
        str, Field(description="The sentence of the controlled language that it was rewritten to.")
    ] = ""
    fields: Annotated[tuple[str, ...], Field(description="Paths of the fields that it sets.")] = ()
    notes: Annotated[tuple[str, ...], Field(description="What is not read, and what is assumed.")] = ()


class BaseSimSpec(Document):
    """The result for a text: a base SimSpec, its ranges, the source of every field, and the passages that
    were not used.
    """

    format: Literal["rebar.prose/4"] = "rebar.prose/4"
    prose: str
    simspec: SimSpec
    ranges: tuple[VariedField, ...] = ()
    receipts: tuple[Receipt, ...] = ()
    choices: tuple[Choice, ...] = ()
    clauses: tuple[ClauseReading, ...] = ()
    not_understood: tuple[UnreadText, ...] = ()
    remarks: Annotated[
        tuple[UnreadText, ...], Field(description="What is read otherwise than it is written, and why.")
    ] = ()
    checked: Annotated[
        bool,
        Field(
            description="Whether a person has compared the values of all `check` clauses with their words."
        ),
    ] = False

    @property
    def open_choices(self) -> tuple[Choice, ...]:
        """The choices that nobody has answered yet."""
        return tuple(choice for choice in self.choices if not choice.answered)

    @property
    def complete(self) -> bool:
        """Whether every choice is answered and nothing is left out."""
        return not (self.open_choices or self.not_understood)

    @property
    def unchecked(self) -> tuple[ClauseReading, ...]:
        """The clauses whose values a person has yet to compare with their words."""
        return tuple(clause for clause in self.clauses if clause.status == "check" and not self.checked)

    @property
    def certain(self) -> bool:
        """Whether the text is read in full, and every sentence is one of the controlled language or checked."""
        return self.complete and not self.unchecked

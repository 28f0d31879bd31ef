"""What a text becomes: a base SimSpec with ranges, receipts and choices, and the account of every clause."""

from __future__ import annotations

from typing import Any, Literal

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
    unit: str | None = Field(None, description="None where the field's name states none.")


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
    chosen: int = Field(1, ge=1, description="Number of the reading that the document has.")
    answered: bool = Field(False, description="Whether a person chose it.")


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
    sentence: str = Field("", description="The sentence of the controlled language that it was rewritten to.")
    fields: tuple[str, ...] = Field((), description="Paths of the fields that it sets.")
    notes: tuple[str, ...] = Field((), description="What is not read, and what is assumed.")


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
    remarks: tuple[UnreadText, ...] = Field(
        (), description="What is read otherwise than it is written, and why."
    )
    checked: bool = Field(
        False, description="Whether a person has compared the values of all `check` clauses with their words."
    )

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

"""Reads intelligence reports: about which group, how old, how accurate, when delivered."""

from __future__ import annotations

import re

from bench.simspec import Role

from .._draft import Draft, FieldPath
from ..language._phrases import Phrase, Quantity
from ..language._tokens import Span
from ._groups import GroupRegister

UNITS = {"latency_s": "s", "delivered_s": "s", "uncertainty_m": "m"}


_ACTIVE = re.compile(
    r"(?<!was )(?<!were )(?<!been )(?<!last )\b(?:seen|spotted|sighted|observed|reported)$", re.IGNORECASE
)
_OBJECT = re.compile(
    r"\s+(?:the|an?|some|two|three|\d+)\s+(?!(?:minutes?|min|seconds?|s|hours?|h|few|m|metres?|meters?|km)\b)[a-z]",
    re.IGNORECASE,
)
"""What follows a verb whose subject has seen, and was not seen."""


class IntelligenceReader:
    """Reads reports into a draft. Numbers of a report wait until its group is known."""

    def __init__(self, draft: Draft, cast: GroupRegister) -> None:
        self._draft, self._groups = draft, cast
        self._report: str | None = None
        self.spoken_of = False
        """Whether the sentence speaks of a report."""
        self._pending: list[tuple[str, Quantity, Span]] = []
        self._of_a_report = False
        """Whether a sentence with a waiting number has spoken of a report."""
        self._report_groups: list[str] = []
        self._candidate_groups: list[str] = []
        """Who was spoken of when what waits was said."""

    def field(self, name: str, quantity: Quantity, span: Span) -> None:
        """Set a number of the current report."""
        of = self._single_group_in_sentence() if name == "priority" or self.spoken_of else None
        if of is not None and (self._report is None or self._report_groups not in ([of], [])):
            self._report, self._report_groups = self.on(of, span), [of]
        if self._report is None:
            self._pending.append((name, quantity, span))
            self._of_a_report = self._of_a_report or self.spoken_of
            self._candidate_groups += self._groups.subject
            return
        if (
            self._groups.in_sentence
            and self._groups.subject != self._report_groups
            and len(self._groups.subject) == 1
        ):
            # `the radar has priority 2, the soldiers have priority 1`.
            spoken = f"{self._groups.subject[0]}-sighting"
            if ("intelligence", spoken, "id") in self._draft.entries:
                self._report = spoken
        path: FieldPath = ("intelligence", self._report, name)
        self._draft.vary(
            path, quantity.low, quantity.high, span, unit=UNITS.get(name), integer=name == "priority"
        )

    def _single_group_in_sentence(self) -> str | None:
        """The single group of this sentence, when a report may be about it."""
        cast = self._groups
        if not cast.in_sentence or len(cast.subject) != 1 or cast.role(cast.subject[0]) is Role.CLUTTER:
            return None
        return cast.subject[0]

    def intelligence(self, phrase: Phrase) -> None:
        if (
            phrase.has("SEEN")
            and _ACTIVE.search(self._draft.quote(phrase.span))
            and _OBJECT.match(self._draft.text, phrase.span.end)
        ):
            # `two scouts spotted the truck` is a report on the truck, if on anybody.
            self._draft.unread(phrase.span, "it does not tell of whom the report is", expressible=True)
            return
        them = phrase.refs[0].first("THEM")
        if them is not None:
            self._groups.them_as_subject(them.span)
        of_subject = self._groups.subject and them is not None
        groups = self._groups.subject if of_subject else self._groups.groups_in(phrase)
        if not self._groups.in_sentence:
            self._groups.subject = groups
        for group in groups:
            if self._groups.role(group) is Role.CLUTTER:
                self._draft.unread(phrase.span, "intelligence here is about adversaries or bystanders")
                continue
            self._report, self._report_groups = self.on(group, phrase.span), list(self._groups.subject)
            if (time := phrase.first("TIME")) and isinstance(time.value, Quantity):
                self.field("delivered_s", time.value, phrase.span)
            pending, self._pending = self._pending, []
            for name, quantity, span in pending:
                self.field(name, quantity, span)

    def known(self, phrase: Phrase) -> None:
        """Read that a report is there from the start."""
        self.field("delivered_s", Quantity("TIME", 0.0, 0.0), phrase.span)

    def last(self) -> list[str]:
        """The group of the report mentioned last."""
        entry = self._draft.entries.get(("intelligence", self._report, "about")) if self._report else None
        return [entry.value] if entry else []

    def on(self, group: str, span: Span) -> str:
        """Id of the report on a group; creates the report when there is none."""
        # One report for each group: the prose has no words that tell two reports on a group apart.
        report = f"{group}-sighting"
        if ("intelligence", report, "id") not in self._draft.entries:
            self._draft.put(("intelligence", report, "id"), report, span)
            self._draft.put(("intelligence", report, "about"), group, span)
        return report

    def finish(self) -> None:
        """Give waiting numbers to the report on the only adversary; with several adversaries, ask."""
        adversaries = self._groups.targets()
        if not self._pending:
            return
        span = self._pending[0][2]
        if not adversaries:
            for _name, _, where in self._pending:
                self._draft.unread(where, "the text mentions no intelligence report", expressible=True)
            return
        adversaries = [group for group in adversaries if group in self._candidate_groups] or adversaries
        choices = [(f"a report on {adversary}", adversary) for adversary in adversaries]
        # A time that is said of no report (`before that, at 40 s`) is hardly one of a report.
        surely = self._of_a_report or any(name != "latency_s" for name, _, _ in self._pending)
        choices.insert(len(choices) if surely else 0, ("none: leave it out", ""))
        chosen = choices[self._draft.ask(span, "about whom is this report?", [name for name, _ in choices])][
            1
        ]
        if not chosen:
            for _name, _, where in self._pending:
                self._draft.unread(where, "it is said of no report", expressible=True)
            return
        self._report = self.on(chosen, span)
        for name, quantity, where in self._pending:
            self.field(name, quantity, where)

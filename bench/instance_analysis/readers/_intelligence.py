"""Reads intelligence reports: about which group, how old, how accurate, when delivered."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import Role

from .._draft import Draft, FieldPath
from ..language._phrases import Phrase, Quantity
from ..language._tokens import Span
from ._group_references import GroupReferences

UNITS = {"latency_s": "s", "delivered_s": "s", "uncertainty_m": "m"}


_ACTIVE = re.compile(
    r"(?<!was )(?<!were )(?<!been )(?<!last )\b(?:seen|spotted|sighted|observed|reported)$", re.IGNORECASE
)
_OBJECT = re.compile(
    r"\s+(?:the|an?|some|two|three|\d+)\s+(?!(?:minutes?|min|seconds?|s|hours?|h|few|m|metres?|meters?|km)\b)[a-z]",
    re.IGNORECASE,
)
"""What follows a verb whose subject has seen, and was not seen."""
_HOW_WELL = re.compile(
    r"\s+(?:only\s+|very\s+|quite\s+|rather\s+)?(?:bad(?:ly)?|poor(?:ly)?|hardly|barely|well|easily|clearly|with difficulty)\b",
    re.IGNORECASE,
)
_PRESENT = re.compile(r"\b(?:is|are|be)\s+(?:\w+\s+)?(?:seen|observed)$", re.IGNORECASE)
_OF_A_REPORT = re.compile(
    r"\d|\b(?:ago|old|last|report\w*|sighting\w*|intel\w*|tip|minutes?|hours?|yesterday|earlier|recently)\b",
    re.IGNORECASE,
)
"""What makes `is seen` the message that somebody has seen them."""


class IntelligenceReader:
    """Reads reports into a draft. Numbers of a report wait until its group is known."""

    def __init__(self, draft: Draft, references: GroupReferences) -> None:
        self._draft, self._references, self._groups = draft, references, references.groups
        self._report: str | None = None
        self.spoken_of = False
        """Whether the sentence speaks of a report."""
        self._number = 0
        """Which report is spoken of: the first, the second; 0 where the text does not count them."""
        self._counted = False
        """Whether this sentence has said which report it speaks of."""
        self._ids: dict[tuple[str, int], str] = {}
        """Ids of the reports, by group and number."""
        self._pending: list[tuple[str, Quantity, Span, int]] = []
        self._of_a_report = False
        """Whether a sentence with a waiting number has spoken of a report."""
        self._report_groups: list[str] = []
        self._candidate_groups: list[str] = []
        """Who was spoken of when what waits was said."""

    def begin_sentence(self, *, spoken_of: bool) -> None:
        """Note that a sentence begins, and whether it speaks of a report."""
        self.spoken_of, self._counted = spoken_of, False

    def count(self, number: int) -> None:
        """Go on with the first or the second report; what follows is said of no other one."""
        self._number, self._counted, self.spoken_of = number, True, True
        self._report, self._report_groups = None, []

    def about(self, groups: Sequence[str], span: Span) -> None:
        """Let a counted report be about the group that its sentence names: `the second one concerns a truck`."""
        if not self._counted or self._report is not None or len(groups) != 1:
            return
        if self._groups.role(groups[0]) is Role.CLUTTER:
            return
        self._report, self._report_groups = self._report_on(groups[0], span), [*groups]
        self._take_pending()

    def _take_pending(self) -> None:
        """Set the numbers that were stated before the group of their report."""
        pending = [item for item in self._pending if item[3] == self._number]
        self._pending = [item for item in self._pending if item[3] != self._number]
        for name, quantity, span, _ in pending:
            self.field(name, quantity, span)

    def field(self, name: str, quantity: Quantity, span: Span) -> None:
        """Set a number of the current report."""
        of = self._single_group_in_sentence() if name == "priority" or self.spoken_of else None
        if self._counted and self._report is None:
            # `the first concerns a radar, the second, priority 1, a truck`: its group is yet to come.
            of = None
        if of is not None and (self._report is None or self._report_groups not in ([of], [])):
            self._report, self._report_groups = self._report_on(of, span), [of]
        if self._report is None:
            self._pending.append((name, quantity, span, self._number))
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
        if phrase.has("SEEN") and self._is_visibility(phrase.span):
            self._draft.unread(phrase.span, "it tells of no report, and of no time", expressible=True)
            return
        them = phrase.refs[0].first("THEM")
        if them is not None:
            self._references.them_as_subject(them.span)
        of_subject = self._groups.subject and them is not None
        groups = self._groups.subject if of_subject else self._references.groups_in(phrase)
        self._number = self._number if self._counted else 0
        if not self._groups.in_sentence:
            self._groups.subject = groups
        for group in groups:
            if self._groups.role(group) is Role.CLUTTER:
                self._draft.unread(phrase.span, "intelligence here is about adversaries or bystanders")
                continue
            self._report, self._report_groups = (
                self._report_on(group, phrase.span),
                list(self._groups.subject),
            )
            if (time := phrase.first("TIME")) and isinstance(time.value, Quantity):
                self.field("delivered_s", time.value, phrase.span)
            self._take_pending()

    def _is_visibility(self, span: Span) -> bool:
        """Whether `seen` says how well somebody can be seen: `they are seen only badly`."""
        text = self._draft.text
        if _HOW_WELL.match(text, span.end):
            return True
        begin = max(text.rfind(mark, 0, span.start) for mark in ".;!?\n") + 1
        end = min((at for mark in ".;!?\n" if (at := text.find(mark, span.end)) >= 0), default=len(text))
        bare = _PRESENT.search(text[begin : span.end]) is not None
        return bare and _OF_A_REPORT.search(text[begin:end]) is None

    def known(self, phrase: Phrase) -> None:
        """Read that a report is there from the start."""
        self.field("delivered_s", Quantity("TIME", 0.0, 0.0), phrase.span)

    def last(self) -> list[str]:
        """The group of the report mentioned last."""
        entry = self._draft.entries.get(("intelligence", self._report, "about")) if self._report else None
        return [entry.value] if entry else []

    def on(self, group: str, span: Span) -> str:
        """Id of the first report on a group; creates the report when there is none."""
        return next(
            (report for (about, _), report in self._ids.items() if about == group), ""
        ) or self._report_on(group, span)

    def _report_on(self, group: str, span: Span) -> str:
        """Id of the report on a group that is spoken of. A report of another number is another one."""
        key = (group, self._number)
        others = [report for (about, _), report in self._ids.items() if about == group]
        if key not in self._ids and others and not self._number:
            return others[0]
        if key not in self._ids:
            report = f"{group}-sighting" + (f"-{len(others) + 1}" if others else "")
            self._ids[key] = report
            self._draft.put(("intelligence", report, "id"), report, span)
            self._draft.put(("intelligence", report, "about"), group, span)
        return self._ids[key]

    def finish(self) -> None:
        """Give waiting numbers to a report on the only adversary; with several adversaries, ask."""
        for number in sorted({number for *_, number in self._pending}):
            self._number = number
            self._finish(
                [(name, quantity, span) for name, quantity, span, of in self._pending if of == number]
            )

    def _finish(self, pending: Sequence[tuple[str, Quantity, Span]]) -> None:
        adversaries = self._groups.targets()
        span = pending[0][2]
        if not adversaries:
            for _name, _, where in pending:
                self._draft.unread(where, "the text mentions no intelligence report", expressible=True)
            return
        adversaries = [group for group in adversaries if group in self._candidate_groups] or adversaries
        choices = [(f"a report on {adversary}", adversary) for adversary in adversaries]
        # A time that is said of no report (`before that, at 40 s`) is hardly one of a report.
        surely = self._of_a_report or any(name != "latency_s" for name, _, _ in pending)
        choices.insert(len(choices) if surely else 0, ("none: leave it out", ""))
        chosen = choices[self._draft.ask(span, "about whom is this report?", [name for name, _ in choices])][
            1
        ]
        if not chosen:
            for _name, _, where in pending:
                self._draft.unread(where, "it is said of no report", expressible=True)
            return
        self._report = self._report_on(chosen, span)
        for name, quantity, where in pending:
            self.field(name, quantity, where)

"""Reads whom a text calls the target, or whom the drone has to find: they are adversaries, or sought."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import Role

from .._draft import Draft, FieldPath
from ..language._phrases import Phrase
from ..language._tokens import Span, Word
from ._groups import GroupRegister
from ._traits import IMMOVABLE, PERSONS, VEHICLES

_TARGET = r"(?:tgts?|targets?)"
_CALLED_BEFORE = re.compile(
    rf"\b{_TARGET}\b\s*(?:(?:is|are|will be|shall be|being)\s+|[:=–-]\s*|,\s*)(?:(?:also|only|an?|one|the|some|\d+\s*x?)\s+)*$",
    re.IGNORECASE,
)
"""`the target is a car`, `Tgt: 1 car`, `the target, a car`: before the noun."""
_LISTED_BEFORE = re.compile(
    rf"\b{_TARGET}\s*(?:[:=]|(?:are|will be|shall be)\s+(?:\d+\s*x?|an?|one|two|three|four|five|six)\b)[^.;:\n]{{0,80}}$",
    re.IGNORECASE,
)
"""`Targets: two trucks, a car`: before every noun of the list."""
_ENEMY = r"(?:hostiles?|enem(?:y|ies)|adversar(?:y|ies|ial)|opfor|opponents?)"
_HOSTILE_BEFORE = re.compile(
    rf"(?<!no\s)(?<!not\s)(?<!non-)\b{_ENEMY}\s+(?:(?!and\b|or\b|of\b)[a-z-]+\s+)?$", re.IGNORECASE
)
"""`a hostile grey pickup`: what makes an enemy of the noun after it."""
_ENEMIES_LISTED = re.compile(
    r"(?:^|[.;\n]\s*)(?:en(?:y|emy|emies)?(?: forces?)?|hostiles|opfor|red force|intruders?|adversar(?:y|ies))\s*:[^.:\n]{0,120}$",
    re.IGNORECASE,
)
_CIVILIANS_LISTED = re.compile(
    r"(?:^|[.;\n]\s*)(?:civ(?:ilian)?s?(?: (?:presence|pattern|picture|pop\w*))?|non-?combatants|neutrals?|bystanders|protected)\s*:[^.:\n]{0,120}$",
    re.IGNORECASE,
)
"""`EN: 2 x vans`, `Civ presence: 15 pax, 1 x bus`: headings that give the role of all that follow them."""
_IS_HOSTILE = re.compile(
    rf"(?:[,(]\s*|[\s,]\s*(?:(?:which|that|who)\s+)?(?:is|are|both|all|treat(?:ed)?(?: them)? as|shall be|being)\s+(?:both\s+|all\s+|to be\s+)?)(?:{_ENEMY}|(?:the\s+)?(?:role of (?:the\s+)?)?{_ENEMY})$",
    re.IGNORECASE,
)
_IS_PROTECTED = re.compile(
    r"(?:[,(]\s*(?:to be\s+)?|\b(?:is|are|be)\s+(?:both\s+|all\s+)?)protected$", re.IGNORECASE
)
_NOUN_FOLLOWS = re.compile(
    r"\s+(?!and\b|or\b|to\b|who\b|which\b|that\b|at\b|in\b|on\b|near\b)[a-z0-9]", re.IGNORECASE
)
_CALLED_AFTER = re.compile(
    rf"\s*(?:[,(]|(?:,\s*)?(?:which|that|who)\s+(?:is|are)\b|\b(?:is|are|shall be|will be)\b)\s*"
    rf"(?:(?:the|our|its|your|my|only|sole|main|also)\s+)*{_TARGET}\b(?!\s+(?:area|list|of)\b)",
    re.IGNORECASE,
)
_SOUGHT_BY = re.compile(
    r"\s*,?\s*(?:(?:which|that|whom|who)\s+)?(?:the\s+|our\s+|your\s+)?(?:uav|uas|drone|agent|quad\w*|aircraft|we|you)\s+"
    r"(?:has|have|must|shall|should|needs?|will|is|are)\s+(?:to\s+)?(?:find|locate|search(?:\s+for)?|look\s+for|detect)\b"
    r"(?!\s+(?:the|an?|it|them|all|\d))",
    re.IGNORECASE,
)
_SOUGHT_BEFORE = re.compile(
    r"\b(?:(?:look|search|hunt)(?:s|ing|ed)?\s+for|locate|find(?:\s+and\s+report)?|wanted)\s*:?\s+"
    r"(?:(?:the|an?|one|two|three|some|\d+\s*x?)\s+)?(?:[a-z-]+\s+)?$",
    re.IGNORECASE,
)
"""`the drone looks for a pickup`: what makes a target of the vehicle after it."""
_TAKEN_BEFORE = re.compile(r"\b(?:stolen|hijacked|getaway)\s+(?:[a-z-]+\s+)?$", re.IGNORECASE)
_OF_ENEMIES = re.compile(
    rf"\s+of\s+(?:the\s+)?(?:{_ENEMY}|smugglers|insurgents|gunmen|gang|thieves|kidnappers|terrorists)\b",
    re.IGNORECASE,
)
"""`two vans of the smugglers`."""
_TO_BE_FOUND = re.compile(
    r"\s*,?\s*(?:(?:which|that|who)\s+)?(?:is|are|has|have|must|shall|should|needs?|will)\s+(?:to\s+)?be\s+"
    r"(?:found|located|searched(?:\s+for)?|looked\s+for|detected)\b",
    re.IGNORECASE,
)
_ARE_THE = re.compile(
    r"\b(?:is|are|shall be|will be)\s+(?:both\s+|all\s+)?(?:the|our|its|your)\s+(?:only\s+)?$", re.IGNORECASE
)


class TargetReader:
    """Sets the role of groups that the text calls targets. `finish` lists the word where nobody is one."""

    def __init__(self, draft: Draft, groups: GroupRegister) -> None:
        self._draft, self._groups = draft, groups
        self._without: list[Span] = []
        """Where the text speaks of a target, and has named none yet."""

    def introduced(self, groups: Sequence[str], phrase: Phrase) -> None:
        """Read what stands right beside a noun that has just named groups."""
        text, noun = self._draft.text, phrase.span
        before = text[max(0, noun.start - 160) : noun.start]
        asset = phrase.first("ASSET")
        head = text[max(0, noun.start - 40) : asset.span.start] if asset is not None else before
        vehicles = [group for group in groups if self._groups.asset(group) in VEHICLES]
        if _HOSTILE_BEFORE.search(head) or _ENEMIES_LISTED.search(before):
            self._set(groups, Role.ADVERSARY, noun)
        elif _TAKEN_BEFORE.search(head) or _OF_ENEMIES.match(text, noun.end):
            self._set(vehicles, Role.ADVERSARY, noun)
        elif match := _SOUGHT_BEFORE.search(head):
            self._call(vehicles, Span(noun.start - len(head) + match.start(), noun.end), sought=True)
        elif _CIVILIANS_LISTED.search(before):
            self._set(vehicles, Role.BYSTANDER, noun)
        if match := _CALLED_BEFORE.search(before):
            self._call(groups, Span(noun.start - len(before) + match.start(), noun.end))
        elif match := _CALLED_AFTER.match(text, noun.end):
            self._call(groups, Span(noun.start, match.end()))
        elif match := _SOUGHT_BY.match(text, noun.end) or _TO_BE_FOUND.match(text, noun.end):
            self._call(groups, Span(noun.start, match.end()), sought=True)
        elif _LISTED_BEFORE.search(before):
            self._ask_of_list(groups, noun)

    def predicated(self, word: Word, groups: Sequence[str]) -> bool:
        """Read `a van and a bus are hostile` and `two ambulances, protected`; whether a word is that."""
        said = self._draft.text[max(0, word.span.start - 60) : word.span.end]
        if _NOUN_FOLLOWS.match(self._draft.text, word.span.end):
            return False
        if _IS_HOSTILE.search(said):
            self._set(groups, Role.ADVERSARY, word.span)
        elif _IS_PROTECTED.search(said):
            self._set(
                [group for group in groups if self._groups.asset(group) in VEHICLES],
                Role.BYSTANDER,
                word.span,
            )
        else:
            return False
        return bool(groups)

    def _set(self, groups: Sequence[str], role: Role, span: Span) -> None:
        """Set the role of groups that has been stated, but for what cannot move."""
        for group in groups:
            present = self._groups.role(group)
            if present is role or present is Role.SOUGHT or self._groups.asset(group) in IMMOVABLE:
                continue
            path: FieldPath = ("actors", group, "role")
            self._draft.forget(path)
            self._draft.put(path, str(role), span)

    def called(self, word: Word, groups: Sequence[str]) -> None:
        """Read `the men and their car are our targets` of the groups that are its subject."""
        if _ARE_THE.search(self._draft.text[: word.span.start]):
            self._call(groups, word.span)
        elif not self._groups.targets():
            self._without.append(word.span)

    def finish(self) -> None:
        """List every word for a target in a text that has none: whom it means is not read."""
        if not self._groups.targets():
            for span in self._without:
                self._draft.unread(span, "nobody in the scene is an adversary or sought", expressible=True)

    def _ask_of_list(self, groups: Sequence[str], noun: Span) -> None:
        """Whether what stands later in a list of targets is one too: `Targets: two trucks, a car`."""
        other = [group for group in groups if self._groups.role(group) not in (Role.ADVERSARY, Role.SOUGHT)]
        readings = ["one of the targets", "no target"]
        if other and self._draft.ask(noun, "is this a target?", readings) == 0:
            self._call(other, noun)

    def _call(self, groups: Sequence[str], span: Span, *, sought: bool = False) -> None:
        """Set the role of groups of which the text says that they are targets."""
        self._draft.acknowledge(span)
        for group in groups:
            asset = self._groups.asset(group)
            if self._groups.role(group) in (Role.ADVERSARY, Role.SOUGHT):
                continue
            if asset in IMMOVABLE:
                self._draft.unread(span, f"no {asset} is a target here", expressible=True)
                continue
            role = Role.ADVERSARY
            if asset in PERSONS:
                roles = (Role.SOUGHT, Role.ADVERSARY)
                readings = ["they are sought", "they are adversaries"]
                role = Role.SOUGHT if sought else roles[self._draft.ask(span, "who is the target?", readings)]
            path: FieldPath = ("actors", group, "role")
            self._draft.forget(path)
            self._draft.put(path, str(role), span)

"""Reads whom the drone escorts: the group, how near the drone stays to it, and how early the drone warns it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.simspec import Role

from .._draft import Draft, FieldPath
from ..language._phrases import Phrase
from ..language._tokens import Span
from ._group_references import GroupReferences
from ._places import PlaceReader
from ._traits import IMMOVABLE, length_of

ESCORT: FieldPath = ("mission", "escort")
EASTWARDS_DEG = 90.0
_ESCORTS = re.compile(r"(?:escort|accompan|protect|guard|shadow)\w*$", re.IGNORECASE)
"""What the drone does with a group that it escorts, and with nothing else."""
_ESCORTED_BY = re.compile(rf"{_ESCORTS.pattern.removesuffix('$')}\s+by$", re.IGNORECASE)


class EscortReader:
    """Reads the escort of a text. `finish` leaves out one whose group is open or has no way."""

    def __init__(self, draft: Draft, references: GroupReferences) -> None:
        self._draft, self._references, self._groups = draft, references, references.groups
        self._first: Span | None = None

    def read(self, phrase: Phrase) -> bool:
        """Read `the drone accompanies the cars within 60 m`, and `it stays within 60 m of the convoy`.

        False for a distance of the drone from anything that it does not escort.
        """
        part = phrase.first("NEAR")
        verb = part is not None and _ESCORTS.match(self._draft.quote(part.span)) is not None
        if phrase.rule not in ("near", "within", "exact") or not phrase.refs:
            return False
        if not verb and not self._is_of_the_escorted(phrase.refs[0]):
            return False
        return self._escort(phrase, self._groups_of(phrase))

    def announces(self, phrase: Phrase) -> bool:
        """Whether a phrase tells of an escort whose convoy is named later: `escort the convoy, four trucks`."""
        part = phrase.first("NEAR") if phrase.rule == "near" else None
        if part is None or self._groups.convoys or not _ESCORTS.match(self._draft.quote(part.span)):
            return False
        if not phrase.refs or not phrase.refs[0].has("CONVOY"):
            return False
        self._first = self._first or phrase.span
        self._draft.acknowledge(phrase.span)
        return True

    def read_passive(self, phrase: Phrase) -> bool:
        """Read `three cars, escorted by the drone`; whether a phrase says that."""
        part = phrase.first("NEAR")
        passive = part is not None and _ESCORTED_BY.match(self._draft.quote(part.span)) is not None
        if not passive or not phrase.refs or not phrase.refs[0].has("HOME"):
            return False
        return self._escort(phrase, self._groups.subject)

    def _groups_of(self, phrase: Phrase) -> list[str]:
        groups = self._groups.convoys if phrase.refs[0].has("THEM") else self._references.groups_in(phrase)
        return [*groups]

    def _escort(self, phrase: Phrase, groups: Sequence[str]) -> bool:
        """Set the escorted group, and the distance where the phrase has one."""
        if len(groups) != 1 or not self._may_be_escorted(groups[0]):
            self._draft.unread(phrase.span, "an escort is of one group that moves and is no target")
            return True
        self._first = self._first or phrase.span
        self._draft.put((*ESCORT, "group"), groups[0], phrase.span)
        if phrase.has("LENGTH"):
            length = length_of(self._draft, phrase)
            self._draft.vary((*ESCORT, "within_m"), length.high, length.high, phrase.span, unit="m")
        return True

    def _is_of_the_escorted(self, ref: Phrase) -> bool:
        """Whether a reference means the convoy of the text, or the group that it escorts."""
        if ref.has("CONVOY", "THEM"):
            return len(self._groups.convoys) == 1
        group = self._draft.entries.get((*ESCORT, "group"))
        asset = ref.first("ASSET")
        return asset is not None and group is not None and self._groups.kinds.get(group.value) == asset.value

    def _may_be_escorted(self, group: str) -> bool:
        return self._groups.asset(group) not in IMMOVABLE and self._groups.role(group) not in (
            Role.ADVERSARY,
            Role.SOUGHT,
        )

    def choose(self, places: PlaceReader) -> None:
        """Choose the escorted group where the text names it nowhere else, and give it a way where it has none."""
        stated = (entry.span for path, entry in self._draft.entries.items() if path[:2] == ESCORT)
        span = next((where for where in stated if where is not None), self._first)
        if span is None:
            return
        if (*ESCORT, "group") not in self._draft.entries:
            candidates = self._groups.convoys or [group for group in self._groups.kinds if self._moves(group)]
            candidates = [group for group in candidates if self._may_be_escorted(group)]
            if not candidates:
                return
            chosen = self._draft.ask(span, "who is escorted?", candidates) if len(candidates) > 1 else 0
            self._draft.put((*ESCORT, "group"), candidates[chosen], span)
        group = self._draft.entries[(*ESCORT, "group")].value
        motion: FieldPath = ("actors", group, "motion")
        kind = self._draft.entries.get((*motion, "kind"))
        if kind is not None and kind.value == "still" and kind.span is not None:
            return
        if (*motion, "route") in self._draft.entries or group in places.travels:
            return
        if kind is None or kind.value == "still":
            self._draft.forget((*motion, "kind"))
            self._draft.put((*motion, "kind"), "wander", span)
        if ("actors", group, "placement", "along", "road") in self._draft.entries:
            self._draft.remark(span, "the text gives the escorted group no way: read as along its road")
            places.patrol(group, span)
        else:
            self._draft.remark(span, "the text gives the escorted group no way: read as from west to east")
            places.travel(group, EASTWARDS_DEG, span)

    def _moves(self, group: str) -> bool:
        """Whether the text says that a group moves."""
        motion = {
            path[3]: entry.value
            for path, entry in self._draft.entries.items()
            if path[:3] == ("actors", group, "motion")
        }
        return motion.get("kind", "still") != "still" or bool({"depart_s", "halt_s", "route"} & motion.keys())

    def finish(self) -> None:
        """Complete what an escort needs; leave it out where its group has no way."""
        stated = {path: entry for path, entry in self._draft.entries.items() if path[:2] == ESCORT}
        spans = [entry.span for entry in stated.values() if entry.span is not None] or [
            span for span in (self._first,) if span is not None
        ]
        if not spans:
            return
        group = self._draft.entries.get((*ESCORT, "group"))
        why = "the text does not say who is escorted" if group is None else self._fault_of(group.value)
        if why:
            self._draft.forget(ESCORT)
            for span in spans:
                self._draft.unread(span, why, expressible=True)
            return
        assert group is not None
        base: FieldPath = ("actors", group.value)
        if self._groups.role(group.value) is Role.CLUTTER:
            self._draft.forget((*base, "role"))
            self._draft.put(
                (*base, "role"), str(Role.BYSTANDER), group.span, "an escorted group is protected"
            )
        if (*base, "motion", "pause_s") not in self._draft.entries:
            self._draft.put((*base, "motion", "pause_s"), 0.0, None, "an escorted group does not rest")

    def _fault_of(self, group: str) -> str:
        kind = self._draft.entries.get(("actors", group, "motion", "kind"))
        if kind is None or kind.value != "patrol":
            return "the escorted group needs a way: say from where to where it moves"
        return ""

"""Numbers that stand after the group that they count: `soldiers: 4`, `the aid workers, seven persons`."""

from __future__ import annotations

import re

from .._draft import Draft
from ..language._phrases import Phrase, Quantity
from ..language._tokens import Span, Word
from ._group_references import GENERIC_PERSONS
from ._groups import GroupRegister
from ._sentence_context import SentenceContext
from ._traits import PERSONS

_AGE = re.compile(r"[\s-]*(?:years?|yrs?|months?|y/?o|already|o['’]clock)\b", re.IGNORECASE)
"""What makes the number before it an age or an hour."""
_NUMBER_ALONE = re.compile(
    r"\s*(?:$|[.,;:)\n]|x\b|in number\b|in all\b|head\b|pieces?\b|(?:I['’]d|we['’]d|I would|we) say\b|would do\b|or so\b)",
    re.IGNORECASE,
)
_PAUSE = re.compile(
    r"[,:(]\s*(?:about |around |only |just |say |let us say |at least |perhaps |maybe |roughly )?$",
    re.IGNORECASE,
)
"""What stands between a noun and its number where the number is added to what is said of them."""
_SAYS_HOW_MANY = re.compile(
    r"\b(?:there (?:are|were|is|was|will be)|(?:are|were) there|of (?:which|whom|them)(?: there)? (?:are|is|were|was)"
    r"|(?:is|are) (?:drawn|sampled|chosen|selected)(?: uniformly)?(?: at random)? from [{\[(]?|number(?:ing| of)|totall?ing|count(?:s|ed|ing)?|how many|in number)[\s:=]*(?:about |only |just |exactly |around |roughly |some |perhaps |maybe |circa |abt )*$",
    re.IGNORECASE,
)
"""What makes the number after it a number of members."""


class LateCounts:
    """Gives groups that were named without a number the one that follows."""

    def __init__(self, draft: Draft, groups: GroupRegister, context: SentenceContext) -> None:
        self.draft, self.groups, self.context = draft, groups, context

    def late_count(self, word: Word, before: Phrase | Word | None) -> bool:
        """Use a number on its own as the number of the subject: `soldiers: 4`, `there are two`."""
        count = next((meaning.value for meaning in word.meanings if meaning.kind == "COUNT"), None)
        of_them = re.match(r"\s+of (?:them|these|those)\b", self.draft.text[word.span.end :], re.IGNORECASE)
        spoken_of = (self.groups.in_sentence or of_them) and len(self.groups.subject) == 1
        if not isinstance(count, Quantity) or not spoken_of or self.context.topic in ("road", "home"):
            return False
        if not of_them and not self._counts_the_subject(word.span):
            return False
        start = before.span if isinstance(before, Phrase) and before.rule == "group" else word.span
        if not self.groups.counts.count_later(
            self.groups.subject[0], count, start.joined(word.span), vague=True
        ):
            return False
        # `there are 20 of them`, `of which there are 20`: the words around the number are read with it.
        text = self.draft.text
        preceding = re.search(
            r"\b(?:of|among) (?:which|whom|them) (?:there )?(?:are|is|were|was) $",
            text[: word.span.start],
            re.I,
        )
        start_at = preceding.start() if preceding else word.span.start
        self.draft.used_words.append(Span(start_at, word.span.end + (of_them.end() if of_them else 0)))
        return True

    def _counts_the_subject(self, number: Span) -> bool:
        """Whether a number after a noun says how many there are: `soldiers: 4`, `there are two`, `trucks, 2 of them`.

        `House number 12`, `the girl is six`, `she has 9 years` name, age and measure: only a plural is counted,
        and nothing but a stop mark may stand between it and its number, or the words that say that it counts.
        """
        group = self.groups.subject[0]
        text = self.draft.text
        if _AGE.match(text, number.end) or text.startswith(" of ", number.end):
            return False
        if _SAYS_HOW_MANY.search(text[: number.start]):
            return True
        entry = self.draft.entries.get(("actors", group, "id"))
        if entry is None or entry.span is None:
            return False
        between = text[entry.span.end : number.start]
        if re.search(r"\d|[(,]\s*(?:was|were)\b", between):
            # `the number of kids to 4 (was 6)`.
            return False
        if group not in self.groups.counts.plural:
            # `truck: 2`, and `radar 1`, which is no name of it.
            return between.strip(" :=x") == "" and (":" in between or text[number.start : number.end] == "1")
        alone = _NUMBER_ALONE.match(text, number.end) is not None
        which_are = self.groups.kinds[group] not in PERSONS and re.search(r"\bwhich are $", between)
        return between.strip(" ,:(=x-\t\n") == "" or (
            alone and (_PAUSE.search(between) or which_are) is not None
        )

    def counts_again(self, phrase: Phrase) -> bool:
        """`the aid workers, seven persons`: whether a phrase gives the number of the group just named."""
        count, asset = phrase.first("COUNT"), phrase.first("ASSET")
        before = self.draft.text[: phrase.span.start].rstrip()
        if count is None or asset is None or len(phrase.parts) > 2 or not before.endswith((",", "(", ":")):
            return False
        generic = self.draft.quote(asset.span).lower() in GENERIC_PERSONS
        named = self.groups.subject if self.groups.in_sentence and not self.context.waiting else []
        if not generic or len(named) != 1 or not isinstance(count.value, Quantity):
            return False
        person = self.groups.asset(named[0]) in PERSONS
        return person and self.groups.counts.count_later(named[0], count.value, phrase.span)

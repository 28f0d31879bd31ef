"""Reads a sentence that is one rule, whatever the order of its words: `the UAV shall not mark a target while a
civilian is within 50 m of it`.

Rules are written in too many orders for a grammar. A sentence is read here only if it has what the rule needs
and nothing else that could mean anything: exactly its numbers, no other thing, no place, no count.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from bench.simspec import Role

from ..language._phrases import Part, Phrase, Quantity
from ..language._tokens import Span, Word
from ..language._vocabulary import FieldWords, Vocabulary
from ..ledger._loaded_words import Load, loaded_words

DENIAL = re.compile(
    r"\b(?:not|no|nor|never|nothing|nobody|cannot|\w+n['’]t|forbidden|forbids?|prohibited|withh\w+|refrain\w*|avoid|hold)\b"
)
MARKING = re.compile(r"\b(?:mark(?:ed|ing|s)?|designat\w+)\b")
ONLY = re.compile(r"\bonly\b")
REPORTING = re.compile(r"\breport(?:s|ed|ing)?\b")
DISTANCE = re.compile(r"\b(?:keep|stay|maintain|remain|approach|come|get|go|closer|nearer|distance|separation|clearance)\b")  # fmt: skip
VERTICAL = re.compile(
    r"\b(?:above|over|below|under|overhead|altitude|height|high|higher|lower|agl|climb|descend)\b"
)
TOO_NEAR = re.compile(r"\b(?:closer|nearer|near|less|within|approach|below|under)\b")
FAR_ENOUGH = re.compile(r"\b(?:at least|minimum|away|more than|no less|not less|clear)\b")
TOO_HIGH, TOO_LOW = (
    re.compile(r"\b(?:above|exceed|higher|over)\b"),
    re.compile(r"\b(?:below|under|lower|descend)\b"),
)
UPPER = re.compile(r"\b(?:below|under|maximum|max|ceiling|at most|up to|limited)\b")
LOWER = re.compile(
    r"\b(?:above(?!\s+(?:the\s+)?(?:home|launch|ground|start|take-?off|sea|mean|point|its))|minimum|min|at least|floor)\b"
)
LINK = re.compile(r"\b(?:link|contact|connection|comms|communications?|datalink|c2|signal)\b")
LOST = re.compile(r"\b(?:lost|loss|lose|loses|down|drops?|fails?|gone|interrupted|breaks?|out)\b")
WHEN = re.compile(r"\b(?:if|when|whenever|on|in case|after|upon|should|once)\b")
REACTIONS = {
    "return": re.compile(r"\b(?:returns?|rtl|rtb|rth|come back|go(?:es)? home|fly home)\b"),
    "hold": re.compile(r"\b(?:holds?|hovers?|waits?|loiters?)\b"),
    "continue": re.compile(r"\b(?:continues?|proceeds?|carry on|carries on|keep going)\b"),
}
AFTER_DELIVERY = re.compile(r"\b(?:after|of|from)\s+(?:\w+\s+){0,3}(?:receipt|receiving|received|delivery|delivered|intelligence|information)\b")  # fmt: skip
HAPPENS = re.compile(r"\b(?:is|are|be|has|have|been|comes?|gets?|lost|loss|drops?|fails?|down|gone|receiv\w+|receipt|delivery|information|intelligence)\b")  # fmt: skip
_VERB_DENIED = re.compile(r"\bnot\b|n['’]t\b|\bnever\b")
UNREAD = re.compile(r"\b(?:unless|except|until|before|instead|without|than\s+\d+\s+(?!m\b|s\b|min))\b")
"""What no rule of the SimSpec can hold: such a sentence is not read here."""
VALUES = frozenset(["LENGTH", "TIME", "SPEED"])
FOREIGN_KINDS = frozenset(
    ["POINT", "CLOCK", "DATE", "PERCENT", "ANGLE", "AREA", "DIM", "SUN", "WEATHER", "WIND", "GUSTS", "GROUND", "NAMED", "NOFLY", "ROAD", "DIR", "EVENT", "ORDER", "MOTOR", "CONCEAL"]
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class RuleSentence:
    """One sentence, with the quantities in it, and what it speaks of."""

    text: str
    span: Span
    quantities: tuple[Part, ...]
    persons: bool
    things: bool
    """Whether it speaks of anything but bystanders and targets."""
    targets: bool
    """Whether it names an adversary."""
    context: str
    """The whole sentence, which may name the drone before its second rule."""

    def matches(self, *patterns: re.Pattern[str]) -> bool:
        """Whether each of the patterns is found in its text."""
        return all(pattern.search(self.text) for pattern in patterns)

    def only(self, *kinds: str) -> bool:
        """Whether these are the kinds of its numbers, in any order."""
        return sorted(part.kind for part in self.quantities) == sorted(kinds)


_EXCEPTION = re.compile(
    r"(?:,?\s*(?:except|apart\s+from|excluding|other\s+than)[^,.;:!?]{0,20}\b(?:take-?off|start)\s+(?:and|or)\s+(?:the\s+)?landing)"
    r"|\s+either(?=\s*(?:$|[,.;]))",
    re.IGNORECASE,
)
"""What a lowest height always excepts, and a word that repeats a denial."""
_JOINT = re.compile(r"[,;]\s*(?:(?:and|but)\s+)?|\s+(?:and|but)\s+|\s+(?=nor\s)", re.IGNORECASE)


def without_exceptions(text: str) -> str:
    """A text of the same length in which no take-off and landing are excepted."""
    return _EXCEPTION.sub(lambda match: " " * len(match.group()), text)


def parts_of_a_rule(text: str, begin: int, end: int) -> list[tuple[int, int]]:
    """The stretches of a sentence between its joints; none where a condition may reach over several of them."""
    joints = list(_JOINT.finditer(text, begin, end))
    if not joints or any(word.load is Load.CONDITION for word in loaded_words(text[begin:end])):
        return []
    starts = [begin, *(joint.end() for joint in joints)]
    return list(zip(starts, [*(joint.start() for joint in joints), end], strict=True))


def rule_of(words: Sequence[Word], text: str, vocabulary: Vocabulary, context: str = "") -> Phrase | None:
    """The rule that a sentence is, as a phrase over all of it; None for any other sentence.

    `context` is the whole sentence where the words are a part of it.
    """
    sentence = _sentence(words, text, vocabulary, context)
    if sentence is None or not _is_accounted_for(sentence, text):
        return None
    readers = (_no_mark, _slow, _loiter, _standoff, _link_lost, _height, _speed, _deadline, _silence)
    parts = next((parts for reader in readers if (parts := reader(sentence)) is not None), None)
    if parts is None:
        return None
    rule, *rest = parts
    assert isinstance(rule, str)
    inner = tuple(part for part in rest if isinstance(part, Part))
    # The last part covers the sentence, so that its words count as read with its numbers.
    return Phrase(rule, (*inner, *sentence.quantities, Part("SENTENCE", None, sentence.span)), sentence.span)


def _is_accounted_for(sentence: RuleSentence, text: str) -> bool:
    """Whether a rule can hold every loaded word: one denial, one condition, its numbers and their bounds."""
    begin, end = sentence.span.start, sentence.span.end
    words = loaded_words(text[begin:end])
    loads = Counter(word.load for word in words)
    if loads[Load.NEGATION] > 1 or loads[Load.CONDITION] > 1 or loads[Load.SHARE] or loads[Load.ALTERNATIVE]:
        return False
    if any(
        word.load is Load.QUANTIFIER and word.text.lower() not in ("any", "all", "every") for word in words
    ):
        return False
    if sentence.matches(UNREAD):
        return False
    conditions = [word.span for word in words if word.load is Load.CONDITION]
    return all(_is_a_situation(sentence.text[span.start :]) for span in conditions) and all(
        any(
            part.span.start <= begin + word.span.start and begin + word.span.end <= part.span.end
            for part in sentence.quantities
        )
        for word in words
        # `above one bystander` counts nobody.
        if word.load is Load.NUMBER and word.text.lower() != "one"
    )


def _is_a_situation(condition: str) -> bool:
    """Whether a condition describes people, the link or a report, and not what is forbidden itself."""
    clause = condition.split(",")[0]
    return (
        not MARKING.search(clause) and not _VERB_DENIED.search(clause) and HAPPENS.search(clause) is not None
    )


def _sentence(words: Sequence[Word], text: str, vocabulary: Vocabulary, context: str) -> RuleSentence | None:
    quantities: list[Part] = []
    persons = things = targets = False
    for word in words:
        kinds = {meaning.kind for meaning in word.meanings}
        if kinds & FOREIGN_KINDS - {"EVENT", "ORDER", "DIR"}:
            return None
        for meaning in word.meanings:
            if isinstance(meaning.value, Quantity) and meaning.kind in VALUES:
                quantities.append(Part(meaning.kind, meaning.value, word.span))
            elif isinstance(meaning.value, Quantity) and (meaning.value.low, meaning.value.high) != (
                1.0,
                1.0,
            ):
                return None
            elif meaning.kind == "ASSET":
                targets = targets or vocabulary.role(str(meaning.value)) is Role.ADVERSARY
                bystander = vocabulary.role(str(meaning.value)) is Role.BYSTANDER
                persons, things = (
                    persons or bystander,
                    things or vocabulary.role(str(meaning.value)) is Role.CLUTTER,
                )
    if not words or (not quantities and not LINK.search(text.lower())):
        return None
    span = words[0].span.joined(words[-1].span)
    lower = text[span.start : span.end].lower()
    persons = (
        persons
        or re.search(r"\b(?:anyone|anybody|someone|somebody|everyone|everybody|humans?)\b", lower) is not None
    )
    return RuleSentence(lower, span, tuple(quantities), persons, things, targets, context.lower() or lower)


RuleParts = tuple[str | Part, ...] | None


def _no_mark(sentence: RuleSentence) -> RuleParts:
    if not sentence.matches(MARKING):
        return None
    # `only if nobody is within 50 m` and `only while people are at least 50 m away` forbid the same.
    allowed = sentence.matches(ONLY, FAR_ENOUGH) and not sentence.matches(DENIAL)
    denied = (sentence.matches(DENIAL, TOO_NEAR) and not sentence.matches(FAR_ENOUGH)) or allowed
    return (
        ("nomark",)
        if denied and sentence.only("LENGTH") and sentence.persons and not sentence.things
        else None
    )


def _slow(sentence: RuleSentence) -> RuleParts:
    most = sentence.matches(DENIAL, re.compile(r"\b(?:exceed|faster|over|above|more)\b")) or sentence.matches(
        UPPER
    )
    fits = sentence.only("LENGTH", "SPEED") and sentence.persons and not sentence.things
    is_close = sentence.matches(re.compile(r"\b(?:within|closer than|nearer than)\b"))
    return ("slow",) if fits and most and is_close and not sentence.matches(MARKING) else None


def _loiter(sentence: RuleSentence) -> RuleParts:
    longer = re.compile(r"\b(?:longer|more than|over|at most)\b")
    over = re.compile(r"\b(?:over|above|overhead)\s+(?:any|a|an|one|the|each|every)\b")
    fits = sentence.only("TIME") and sentence.persons and not sentence.things
    read = fits and sentence.matches(DENIAL, longer, over) and not sentence.matches(REPORTING)
    return ("loiter",) if read else None


def _standoff(sentence: RuleSentence) -> RuleParts:
    has_distance = sentence.matches(DENIAL, TOO_NEAR) or (
        sentence.matches(FAR_ENOUGH) and not sentence.matches(DENIAL)
    )
    of_the_drone = (
        sentence.matches(DISTANCE) and not sentence.matches(MARKING) and not sentence.matches(REPORTING)
    )
    fits = (
        sentence.only("LENGTH")
        and sentence.persons
        and not sentence.things
        and not sentence.matches(VERTICAL)
    )
    return (
        ("standoff",) if has_distance and of_the_drone and fits and _speaks_of_the_drone(sentence) else None
    )


def _speaks_of_the_drone(sentence: RuleSentence) -> bool:
    drone = r"\b(?:drone|uav|uas|aircraft|quadcopter|platform|vehicle under test|agent)\b"
    order = r"(?:always |please )?(?:keep|stay|maintain|remain|do not|don['’]t|never|avoid|must|shall)\b"
    return re.search(drone, sentence.text) is not None or re.match(order, sentence.text) is not None


def _link_lost(sentence: RuleSentence) -> RuleParts:
    reactions = [name for name, pattern in REACTIONS.items() if sentence.matches(pattern)]
    fits = sentence.matches(LINK, LOST, WHEN) and not sentence.matches(DENIAL) and len(reactions) == 1
    if not fits or not (sentence.only() or sentence.only("TIME")) or sentence.persons or sentence.things:
        return None
    return ("linklost", Part("LINKDO", reactions[0], sentence.span))


def _field(path: str, kind: str, sentence: RuleSentence) -> RuleParts:
    words = FieldWords.model_validate({"kind": kind, "path": path, "words": ()})
    return ("field", Part("FIELD", (words,), sentence.span))


_ABOVE_HOME = re.compile(
    r"\babove\s+(?:the\s+)?(?:home|launch|ground|start|take-?off|sea|mean|point)\b(?:\s+(?:point|level|sea\s+level))?"
)
"""What a height is measured from."""


def _height(sentence: RuleSentence) -> RuleParts:
    sentence = replace(sentence, text=_ABOVE_HOME.sub(" ", sentence.text))
    if not sentence.only("LENGTH") or sentence.persons or sentence.things or not sentence.matches(VERTICAL):
        return None
    if not (
        _speaks_of_the_drone(sentence)
        or re.search(r"\b(?:altitude|height|agl|fly|flying)\b", sentence.context)
    ):
        return None
    high = sentence.matches(DENIAL, TOO_HIGH) or (sentence.matches(UPPER) and not sentence.matches(DENIAL))
    low = sentence.matches(DENIAL, TOO_LOW) or (sentence.matches(LOWER) and not sentence.matches(DENIAL))
    if high == low:
        return None
    return _field("rules.max_altitude_m" if high else "rules.min_altitude_m", "LENGTH", sentence)


def _speed(sentence: RuleSentence) -> RuleParts:
    faster = re.compile(r"\b(?:exceed|faster|over|above|more)\b")
    most = sentence.matches(DENIAL, faster) or (sentence.matches(UPPER) and not sentence.matches(DENIAL))
    fits = sentence.only("SPEED") and not sentence.persons and not sentence.things
    of_the_drone = _speaks_of_the_drone(sentence) or sentence.matches(re.compile(r"\b(?:speed|fly)\b"))
    return _field("rules.max_speed_mps", "SPEED", sentence) if fits and most and of_the_drone else None


def _deadline(sentence: RuleSentence) -> RuleParts:
    late = re.compile(r"\b(?:within|no later than|not later than|at most|at the latest)\b")
    if sentence.targets:
        # `shall report a radar within 90 s of the delivery` also says that there is a radar.
        return None
    fits = sentence.matches(REPORTING, late, AFTER_DELIVERY) and sentence.only("TIME") and not sentence.things
    return _field("rules.report_deadline_s", "TIME", sentence) if fits and not sentence.persons else None


def _silence(sentence: RuleSentence) -> RuleParts:
    between = re.compile(r"\b(?:between|from|during)\b")
    ranged = len(sentence.quantities) == 1 and isinstance(span := sentence.quantities[0].value, Quantity) and not span.single  # fmt: skip
    fits = sentence.matches(REPORTING, DENIAL, between) and sentence.only("TIME") and ranged
    return ("window", Part("NOREPORT", None, sentence.span)) if fits and not sentence.persons else None

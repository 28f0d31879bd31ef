"""Finds the words that change what a sentence says: numbers, negations, conditions, shares, alternatives.

It reads the text itself, not what the vocabulary made of it, so a word that a phrase has swallowed is found
all the same.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

from ..language._tokens import Span


class Load(StrEnum):
    """What a word does to its clause. The value is the reason that is shown where nobody has read the word."""

    NEGATION = "it denies or forbids something"
    CONDITION = "it is a condition, and no rule of the SimSpec is read from it"
    SHARE = "it speaks of some members of a group"
    ASIDE = "it speaks of another occasion, or to somebody"
    INSTRUCTION = "it speaks to whoever reads the text, and not of the situation"
    SUBORDINATE = "it tells something more of what is known, and no statement is read from it"
    ALTERNATIVE = "it leaves open which of several things holds"
    BOUND = "it is a bound, and only the number is read"
    QUANTIFIER = "it says for how many something holds"
    STRANGER = "it is not known, and may say whose the value is"
    HOSTILE = "it makes somebody an enemy who is none in the asset catalogue"
    ARMED = "it arms somebody who is no enemy in the asset catalogue"
    MOMENT = "it gives a time, and the value is read as that of the whole mission"
    NUMBER = "the number belongs to nothing that is read here"


LEFT_OUT = frozenset(
    [
        Load.NEGATION,
        Load.CONDITION,
        Load.SHARE,
        Load.ALTERNATIVE,
        Load.ASIDE,
        Load.INSTRUCTION,
        Load.SUBORDINATE,
    ]
)
"""What would turn the meaning of the rest around: the clause is left out. With the others it is kept."""


@dataclass(frozen=True, slots=True)
class LoadedWord:
    """A word that somebody must read."""

    load: Load
    text: str
    span: Span


_ONES = "one|two|three|four|five|six|seven|eight|nine"
_TEENS = "ten|eleven|twelve|thirteen|fourteen|fifteen|sixteen|seventeen|eighteen|nineteen"
_TENS = "twenty|thirty|forty|fifty|sixty|seventy|eighty|ninety"
_COUNT = rf"(?<![A-Za-z_])\d+(?:[.,:]\d+)*|\b(?:(?:{_TENS})(?:[-\s](?:{_ONES}))?|{_TEENS}|{_ONES})\b"
_MOMENT = rf"\s+(?:(?:[th]\s*[=+]\s*)?(?:{_COUNT})\s*-?(?:s|sec|secs|seconds?|min|minutes?)\b|(?:minute|second)\s+(?:{_COUNT})|t\s*=|(?:the\s+)?(?:start|launch|take-?off|h-?hour)\b(?!\s+of))"
"""A time of the mission, which is no condition."""
_MEMBERS = r"(?:the|these|those|them|which|whom|us|its|their|his|her)\b"
_WORDS: dict[Load, str] = {
    Load.NEGATION: r"""no|not|nor|never|none|neither|without|nobody|nothing|nowhere|cannot|\w+n['’]t|no-one|nil
        |lacks?|lacking|absent|free\s+of|devoid|minus|negative|false|wrong|denied|denies
        |except|exclud\w+|ruled\s+out|instead|rather|other\s+than|apart\s+from|all\s+but
        |forbid\w*|forbade|prohibit\w*|disallow\w*|ban|banned|avoid\w*|refrain\w*|withhold\w*|withheld|off-limits
        |disregard\w*|ignor\w*|cancel\w*|correction|sorry|scratch\s+that|i\s+mean|hardly|barely|outside(?!\s*(?:$|[,.;]))""",
    Load.CONDITION: rf"""(?<!what\s)if|when|whenever|unless|until(?!\s+then|{_MOMENT}|\s+(?:it|the\s+link|contact)\s+(?:comes|is|returns)\b|\s+(?:it|they)\s+(?:halts?|stops?)\b)|till(?!{_MOMENT})|(?<!at\s)once|provided|in\s+case|in\s+the\s+event|upon
        |after(?!{_MOMENT})|before(?!{_MOMENT}|\s+that\b)|whil(?:e|st)(?!\s+(?:the\s+)?(?:{_COUNT}|an?\b|some|several|others?|rest|remaining|flying\s+(?:at\s+)?(?:{_COUNT}))\b)|as\s+soon\s+as|as\s+long\s+as
        |(?<=,\s)otherwise|depending|assuming|whether|by\s+the\s+time
        |should(?=\s+(?:the|an?|any|it|there|someone|somebody)\b)""",
    Load.SHARE: rf"""(?:{_COUNT}|some|most|many|few|several|any|the\s+rest|majority|a\s+couple|a\s+few
        |each|either|both)\s+(?:of|among)\s+{_MEMBERS}|(?:of|among)\s+(?:which|whom)|(?:^|(?<=[.,;:]\s))of\s+(?:the|these|those)(?=\s+(?:{_COUNT}))
        |(?:{_COUNT})(?=\s+(?:is|are|was|were|has|have)\b)
        |half(?!\s+an?\s+(?:minute|hour|second|metre|meter|kilomet\w+|mile)\b)|halves|thirds?|quarters?|fifths?|tenths?|majority|(?<!at\s)(?<!\sthe\s)most|respectively|twice|thrice|double|triple|as\s+(?:many|few)
        |a\s+(?:second|third)(?=,?\s+[a-z])|the\s+(?:others?(?!\s+side\b)|rest(?!:)|remaining|remainder|former|latter|last|first(?!\s+(?:{_COUNT})\s*-?(?:s|seconds?|min|minutes?)\b)|second(?!\s+(?:scenario|test|run|variant))|fourth)|others|alternat\w+|includ\w+""",
    Load.ASIDE: r"""(?:last|next|another|previous|earlier)\s+(?:time|year|month|week|night|run|flight|sortie|mission|exercise)
        |the\s+(?:day|week|year)\s+before|yesterday|previously|formerly|back\s+then|in\s+the\s+past|used\s+to
        |(?:had|was|were)\s+(?:originally\s+)?(?:planned|intended|meant)|originally
        |(?:say\s+)?(?:hello|hi)\s+to|greet\w*\s+(?:the|to|from)|regards\s+to|give\s+my|love\s+to|thank\w*\s+to""",
    Load.INSTRUCTION: r"""forget|(?:message|note)\s+to\s+(?:the\s+)?(?:computer|reader|machine|parser|program\w*|model|software)
        |(?:who|whoever|whatever)\s+(?:or\s+what\w*\s+)?(?:reads?|process\w*)""",
    Load.SUBORDINATE: r"(?<!\bfrom\s)where(?!\s+the\s+(?:drone|uav|uas|aircraft)\s+(?:starts?|takes?\s+off|launch(?:es)?|begins?)\b)(?=\s+(?:the|these|those|they)\b(?!\s+\w+\s+(?:was|were|is|are|been)\s+(?:last\s+)?(?:seen|spotted|sighted)))",
    Load.ALTERNATIVE: r"or(?!\s+so\b)|either|and/or|alternatively|versus|vs",
    Load.BOUND: rf"""at\s+least|at\s+most|(?:more|less|fewer|lower|higher|closer|nearer|farther|further)\s+than|up\s+to
        |(?:over|under|above|below|beyond|within)(?=\s+(?:{_COUNT}|an?\s+(?:hundred|dozen|minute|hour|kilomet)))
        |exceed\w*|maximum|minimum|max|min(?=\.|imum)|at\s+the\s+most|or\s+(?:more|less|fewer)""",
    Load.QUANTIFIER: r"each|every|all|both|any|apiece|per|altogether|in\s+total|in\s+all",
}
_PATTERNS = {
    load: re.compile(rf"(?<!\w)(?:{words})(?!\w)", re.IGNORECASE | re.VERBOSE)
    for load, words in _WORDS.items()
} | {Load.NUMBER: re.compile(rf"{_COUNT}|\b(?:hundred|thousand|dozen|couple|pair|zero)\b", re.IGNORECASE)}


_WHILE_OF_A_RULE = re.compile(
    rf"\b(?:not|never|no|cannot|\w+n['’]t|forbidden|prohibited|only)\b[^.;!?\n]*?\b(while|whilst)\b"
    rf"(?=\s+(?:the\s+|flying\s+(?:at\s+)?)?(?:{_COUNT}|an?\b|some|several))",
    re.IGNORECASE,
)
"""`while a person is near` after something forbidden is a condition, and places nobody."""


_SIGNS = re.compile(r"(?<![-=])[<>≤≥]=?(?=\s?\d)")
_HOSTILE = re.compile(
    r"\b(?:enem(?:y|ies)|hostiles?|adversar\w+|opfor|suspected|suspects?|targets?)\b", re.IGNORECASE
)


_ARMED = re.compile(
    r"\b(?:armed|(?:with|has|have|carr(?:y|ies|ying))\s+(?:an?\s+)?(?:pistols?|rifles?|guns?|knife|knives|weapons?))\b",
    re.IGNORECASE,
)


def hostile_words(text: str) -> list[LoadedWord]:
    """Every word that makes an enemy of what follows it, and every weapon of what stands before it."""
    before, after = _HOSTILE.finditer(text), _ARMED.finditer(text)
    return [
        *(LoadedWord(Load.HOSTILE, match.group(), Span(*match.span())) for match in before),
        *(LoadedWord(Load.ARMED, match.group(), Span(*match.span())) for match in after),
    ]


def loaded_words(text: str) -> list[LoadedWord]:
    """Every loaded word of a text, in order. One place may carry several loads."""
    words = [
        LoadedWord(load, match.group(), Span(*match.span()))
        for load, pattern in _PATTERNS.items()
        for match in pattern.finditer(text)
    ]
    words += [
        LoadedWord(Load.CONDITION, match.group(1), Span(*match.span(1)))
        for match in _WHILE_OF_A_RULE.finditer(text)
    ]
    words += [LoadedWord(Load.BOUND, match.group(), Span(*match.span())) for match in _SIGNS.finditer(text)]
    return sorted(words, key=lambda word: word.span.start)

"""Splits a text into sentences of tokens: words, numbers and marks, each with its place in the text."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_UNIT_AHEAD = r"(?=\s?(?:k?m\b|m/s|km/h|kn|s\b|min|%|°|deg|met))"
_TOKEN = re.compile(
    rf"""(?P<clock>\d{{1,2}}:\d\d)
    |(?P<iso>\d{{4}}-\d\d-\d\d)
    |(?P<number>\d{{1,3}}(?:,\d{{3}})+(?:\.\d+)?(?![\d,])|0,\d+|\d+,\d{{1,2}}{_UNIT_AHEAD}|\d*\.\d+|\d+)
    |(?P<unit>m/s|km/h|ft/s|km²|m²|km2\b|m2\b|<=|>=)
    |(?P<word>[^\W\d_]+(?:['’-][^\W\d_]+)*\d*)
    |(?P<stop>[.;!?\n])
    |(?P<mark>\.\.+|\S)""",
    re.VERBOSE,
)
_ABBREVIATIONS = frozenset(
    ["approx", "max", "min", "alt", "incl", "nr", "no", "ca", "e.g", "i.e", "mr", "dr", "st", "resp"]
)
FULL_LINE_CHARACTERS = 60
"""Characters from which on a line may have been broken because it was full: editors break them between 65 and 80. Chosen."""
_ITEM = re.compile(r"\s*(?:[-*•–]\s|\d+[.)]\s)")
_HEADING = re.compile(r"(?:^|(?<=\n))[ \t]*(?:[-*•–]|\d{1,2}[.)]|[a-z]\))[ \t]+", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Span:
    """A range of characters of the prose, end excluded."""

    start: int
    end: int

    def joined(self, other: Span) -> Span:
        return Span(min(self.start, other.start), max(self.end, other.end))


@dataclass(frozen=True, slots=True)
class Token:
    """A word, number or mark in lower case, and where it stands. Tokens of a rewritten sentence stand where its quote does."""

    text: str
    kind: str
    span: Span


@dataclass(frozen=True, slots=True)
class Sentence:
    """The tokens of a sentence, without its stop."""

    tokens: tuple[Token, ...]
    question: bool = False

    @property
    def span(self) -> Span:
        return self.tokens[0].span.joined(self.tokens[-1].span)


def tokens_of(text: str, at: Span | None = None) -> list[Token]:
    """All tokens of a text; with `at`, each of them has this place."""
    bullets = {index for match in _HEADING.finditer(text) for index in range(match.start(), match.end())}
    return [
        Token(
            match.group().lower().replace("’", "'"),
            match.lastgroup or "",
            at or Span(match.start(), match.end()),
        )
        for match in _TOKEN.finditer(text)
        if match.start() not in bullets or match.group() == "\n"
    ]


def sentences_of(text: str) -> Iterator[Sentence]:
    """The sentences of a text in order; a semicolon and the end of a line end them too."""
    run: list[Token] = []
    for token in [*tokens_of(text), Token("\n", "stop", Span(len(text), len(text)))]:
        if token.kind != "stop" or _goes_on(token, run, text):
            if token.kind != "stop":
                run.append(token)
            continue
        if run:
            yield Sentence(tuple(run), question=token.text == "?")
        run = []


def _goes_on(stop: Token, run: list[Token], text: str) -> bool:
    """Whether a stop is that of an abbreviation, or the break of a line that was full."""
    if stop.text == "\n" and stop.span.end < len(text):
        return _wrapped(text, stop.span.start)
    after = text[stop.span.end : stop.span.end + 2]
    return stop.text == "." and bool(run) and run[-1].text in _ABBREVIATIONS and after[1:].islower()


def _wrapped(text: str, at: int) -> bool:
    line = text[text.rfind("\n", 0, at) + 1 : at]
    following = text[at + 1 :].split("\n", 1)[0]
    return (
        len(line) >= FULL_LINE_CHARACTERS
        and bool(following.strip())
        and _ITEM.match(following) is None
        and not line.rstrip().endswith((".", ";", "!", "?", ":"))
    )


_AMBIGUOUS = re.compile(r"[1-9]\d{0,2}(?:\.\d{3})+")
_DEGREES = frozenset(["°", "degrees", "n", "e", "s", "w", "north", "east", "south", "west"])


def ambiguous_numbers(tokens: Sequence[Token]) -> list[int]:
    """The places of numbers such as `1.500`, which half of the world reads as 1500. Degrees of latitude have three decimals."""
    after = [token.text for token in tokens[1:]] + [""]
    return [
        at
        for at, token in enumerate(tokens)
        if _AMBIGUOUS.fullmatch(token.text) and after[at] not in _DEGREES
    ]


def number_of(token: Token) -> float | None:
    """The value of a number in figures: `1,200` is a thousand and more, `3,5` before a unit a decimal comma."""
    if token.kind != "number":
        return None
    decimal = re.fullmatch(r"\d+,\d{1,2}|0,\d+", token.text) is not None
    return float(token.text.replace(",", "." if decimal else ""))

"""The page of the controlled language, made from the forms that the parser reads: `rebar prose --page` prints it.

A language model is given the same, without the fields that each sentence sets.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import resources

import yaml

from .language._grammar import forms
from .language._vocabulary import AssetWords, Vocabulary, load_vocabulary

SHOWN_NOUNS = 4
"""Nouns of each asset that the page names: the first of its list. The parser knows more."""
_SHOWN_UNITS = ("m", "km", "ft", "yd", "mile", "nmi", "s", "min", "h", "m/s", "km/h", "mph", "knots", "°", "%", "wh", "km²", "ha")  # fmt: skip


@cache
def page(*, fields: bool = True) -> str:
    """The whole page, as Markdown; without the fields that sentences set it is shorter by a third, for a language model."""
    text = resources.files(f"{__package__}.language").joinpath("page.yaml").read_text(encoding="utf-8")
    parts: dict[str, str] = yaml.safe_load(text)
    vocabulary = load_vocabulary()
    tables = vocabulary.tables
    units = [word for word in tables["unit"] if word in _SHOWN_UNITS]
    filled = {
        "units": ", ".join(units),
        "vague": ", ".join(f"`{word}` ({low} to {high})" for word, (low, high) in tables["vague"].items()),
        "things": "\n".join(_things(vocabulary)),
        "adjectives": ", ".join([*tables["concealment"], *tables["moving"]]),
        "colors": ", ".join(dict.fromkeys(tables["color"].values())),
        "grounds": ", ".join(tables["ground"]),
        "motions": ", ".join(f"`{words.words[0]}`" for words in vocabulary.motions.values()),
        "intensities": ", ".join(f"`{word}` ({level:g})" for word, level in tables["intensities"].items()),
    }
    names = ("intro", "numbers", "words")
    head = "\n".join(parts[name].format(**filled) if name != "intro" else parts[name] for name in names)
    return "\n".join([head, *_tables(fields), parts["cannot"], parts["example"]])


def _things(vocabulary: Vocabulary) -> Iterator[str]:
    """One line for each role, with the things that have it by themselves."""
    for role in ("adversary", "bystander", "clutter"):
        nouns = [_nouns(name, words) for name, words in vocabulary.assets.items() if words.role == role]
        yield f"- {role}: {'; '.join(nouns)}"


def _nouns(name: str, words: AssetWords) -> str:
    shown = dict.fromkeys([name.replace("-", " "), *words.words[:SHOWN_NOUNS], *words.kinds])
    return ", ".join(shown if name != "civilian-truck" else list(shown)[:SHOWN_NOUNS])


def _tables(fields: bool) -> Iterator[str]:
    number = 0
    for section in forms().sections:
        yield f"## {section.title}\n"
        if section.note:
            yield f"{section.note}\n"
        if fields:
            yield "| | write | it sets |\n| --- | --- | --- |"
        for form in section.forms:
            if form.write:
                number += 1
                sentences = " or ".join(f"`{sentence}`" for sentence in form.write)
                yield f"| {number} | {sentences} | {form.shows} |" if fields else sentences
        yield ""

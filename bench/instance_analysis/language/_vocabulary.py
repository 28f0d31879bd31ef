"""The vocabulary: a document that users can extend, and the meanings of each word."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from bench.documents import Document, load_document, read_document
from bench.errors import Fault, SetupError
from bench.simspec import Identifier, Role, asset_fault

from ._spelling import MIN_CORRECTED_LETTERS, UNCORRECTABLE_KINDS

Words = tuple[str, ...]
Kind = Literal["NUMBER", "LENGTH", "TIME", "SPEED", "ANGLE", "PERCENT", "AREA", "ENERGY"]


class AssetWords(Document):
    """Words for an asset. The key of the entry becomes the group's id in the SimSpec."""

    asset: Identifier
    role: Role
    words: Words
    kinds: Annotated[
        dict[Identifier, Words],
        Field(description="Assets that some of these words name more exactly, each with its words."),
    ] = {}

    def named_by(self, noun: str) -> str:
        """The asset that a noun of `words` names."""
        noun = " ".join(noun.lower().split())
        return next(
            (asset for asset, words in self.kinds.items() if any(noun in _plurals(word) for word in words)),
            self.asset,
        )


class WeatherWords(Document):
    """Words for a field of the environment; `level` when the word alone implies one."""

    path: str
    level: float | None = None
    words: Words


class MotionWords(Document):
    """Words for a motion, and the speed that they imply."""

    kind: Literal["still", "wander"]
    speed_mps: float | None = None
    patrol: Annotated[bool, Field(description="Along points where they are given.")] = False
    pace: Annotated[bool, Field(description="Only a speed, which replaces that of the word before it.")] = (
        False
    )
    words: Words


class FieldWords(Document):
    """Words that name a field for a quantity of this kind beside them."""

    kind: Kind
    path: str
    words: Words


class SetWords(Document):
    """A phrase that sets fields on its own."""

    set: dict[str, float | bool | str]
    words: Words


class EventForm(Document):
    """What tells of an event at a moment of the flight: a sign of each kind, in one clause, in any order."""

    part: Literal["vehicle.failures", "outages", "orders", "consents"]
    kind: str
    all: Annotated[
        Words,
        Field(
            description="Patterns; `@NAME` stands for a pattern of `signs`. The last one says what happens."
        ),
    ]
    also: Words = ()
    none: Words = ()
    context: Annotated[
        Words, Field(description="Patterns that may also stand in another clause of the sentence.")
    ] = ()
    numbers: Annotated[
        dict[Literal["PERCENT", "FRACTION", "SPEED", "DIR", "COUNT"], bool],
        Field(description="Numbers that it takes beside times, and whether it needs them."),
    ] = {}


class RuleForm(Document):
    """What makes a clause a rule or a limit: signs in any order, and exactly these numbers."""

    sets: Annotated[
        dict[str, float | bool | str],
        Field(
            description="Fields, and for each a value or the kind of the number that it takes (`TIME?`: if there is one)."
        ),
    ] = {}
    window: Annotated[
        Literal["open", "closed"] | None, Field(description="Times at which reports are allowed, or not.")
    ] = None
    early: Annotated[
        bool,
        Field(description="Whether it is looked for in clauses that stand together before any other in one."),
    ] = False
    loose: Annotated[bool, Field(description="Whether its signs are denials and conditions themselves.")] = (
        False
    )
    remark: Annotated[str, Field(description="Said of what is read differently from how it is written.")] = ""
    of: Annotated[
        Literal["bystanders", "nobody", "anybody"],
        Field(description="Whom the clause must speak of; with `anybody`, whom it may."),
    ] = "nobody"
    all: Words
    also: Annotated[
        Words, Field(description="Patterns that may stand in the clause, and that the rule then holds.")
    ] = ()
    none: Words = ()
    context: Words = ()

    def takes(self, kinds: list[str]) -> bool:
        """Whether these are the kinds of its numbers, sorted."""
        if self.window:
            return "TIME" in kinds and set(kinds) <= {"TIME", "COUNT"}
        named = [value for value in self.sets.values() if isinstance(value, str) and value.isupper()]
        every = sorted(value.rstrip("?") for value in named)
        return kinds in (every, sorted(value for value in named if not value.endswith("?")))


MAX_SIGN_DEPTH = 4
"""Signs within signs. Chosen."""


@dataclass(frozen=True, slots=True)
class CompiledForm:
    """A form with its patterns."""

    form: EventForm | RuleForm
    all: tuple[re.Pattern[str], ...]
    also: tuple[re.Pattern[str], ...]
    none: tuple[re.Pattern[str], ...]
    context: tuple[re.Pattern[str], ...]

    def spans(self, text: str, context: str | None = None) -> list[tuple[int, int]] | None:
        """Where the signs stand in the clause; None where one is missing. Without a context it asks for none."""
        matches = [pattern.search(text) for pattern in self.all]
        if any(pattern.search(text) for pattern in self.none):
            return None
        around = context is None or all(pattern.search(context) for pattern in self.context)
        if not all(matches) or not around:
            return None
        return [
            match.span() for match in (*(pattern.search(text) for pattern in self.also), *matches) if match
        ]


class Defaults(Document):
    """Numbers used when the prose gives none; each use is shown as a default."""

    near_m: Annotated[float, Field(gt=0.0)] = 50.0
    exact_share: Annotated[
        float, Field(gt=0.0, lt=1.0, description="A distance without a range may be off by this share.")
    ] = 0.1
    road_width_m: Annotated[float, Field(gt=0.0)] = 6.0
    area_east_m: Annotated[float, Field(gt=0.0)] = 600.0
    area_north_m: Annotated[float, Field(gt=0.0)] = 250.0


class VocabularyDocument(Document):
    """A vocabulary document. Every part is optional."""

    assets: dict[Identifier, AssetWords] = {}
    ambiguous: Annotated[dict[str, Words], Field(description="A word, and the assets that it may be.")] = {}
    numbers: dict[str, float] = {}
    vague: dict[str, tuple[int, int]] = {}
    units: dict[Kind, dict[str, float]] = {}
    per_area: dict[str, float] = {}
    directions: dict[str, float] = {}
    intensities: dict[str, float] = {}
    winds: dict[str, float] = {}
    weather: dict[str, WeatherWords] = {}
    suns: dict[str, Literal["rise", "set", "noon", "midnight"]] = {}
    motions: dict[str, MotionWords] = {}
    axes: Annotated[dict[str, float], Field(description="How a road runs, in degrees below 180.")] = {}
    ordinals: dict[str, int] = {}
    fractions: dict[str, float] = {}
    concealments: dict[str, float] = {}
    words: Annotated[
        dict[str, Words], Field(description="Words of the grammar, by the grammar's own names.")
    ] = {}
    bounds: Annotated[
        dict[Literal["WITHIN", "ATLEAST"], Words],
        Field(description="Comparatives that bound from above or below."),
    ] = {}
    denials: Annotated[
        Words, Field(description="Words that turn a comparative after them into its opposite.")
    ] = ()
    fields: tuple[FieldWords, ...] = ()
    sets: tuple[SetWords, ...] = ()
    signs: Annotated[dict[str, str], Field(description="Patterns that forms refer to as `@NAME`.")] = {}
    rules: tuple[RuleForm, ...] = ()
    events: tuple[EventForm, ...] = ()
    defaults: Defaults | None = None
    strangers: Annotated[
        Words, Field(description="Words known for none of these: always listed, never mended.")
    ] = ()
    unused: Annotated[
        Words,
        Field(description="Words that tell something which no field holds: listed where nothing reads them."),
    ] = ()
    fillers: Annotated[Words, Field(description="Words that change nothing.")] = ()


@dataclass(frozen=True, slots=True)
class Meaning:
    """A meaning of a word: the grammar's token name and a value."""

    kind: str
    value: object = None


class Vocabulary:
    """The meanings of each phrase, from one or more documents.

    Assets of an earlier document take precedence.
    """

    def __init__(self, documents: list[VocabularyDocument]) -> None:
        self.assets: dict[str, AssetWords] = {}
        self.defaults = next((source.defaults for source in documents if source.defaults), Defaults())
        self.meanings: dict[str, tuple[Meaning, ...]] = {}
        for document in documents:
            self.assets = document.assets | self.assets
            added: dict[str, list[Meaning]] = {}
            for phrase, meaning in _meanings(document):
                if meaning not in added.setdefault(phrase, []):
                    added[phrase].append(meaning)
            for phrase, meanings in added.items():
                earlier = self.meanings.get(phrase, ())
                known = {source.kind for source in earlier}
                self.meanings[phrase] = earlier + tuple(
                    source for source in meanings if source.kind not in known or source.kind == "FIELD"
                )
        signs = {name: pattern for source in reversed(documents) for name, pattern in source.signs.items()}
        self.rules = tuple(_compiled(form, signs) for source in documents for form in source.rules)
        self.events = tuple(_compiled(form, signs) for source in documents for form in source.events)
        fillers = {word.lower() for source in documents for word in (*source.fillers, *source.unused)}
        # A user's vocabulary may give a meaning to a word that the bench ignores.
        self.fillers = frozenset(fillers - set(self.meanings))
        self.unused = self.fillers & {word.lower() for source in documents for word in source.unused}
        self.longest = max(len(phrase.split()) for phrase in (*self.meanings, *self.fillers))
        self.single = frozenset(word for phrase in self.meanings for word in phrase.split() if word.isalpha())
        others = [*self.fillers, *(word.lower() for source in documents for word in source.strangers)]
        self.plain = self.single | {word for phrase in others for word in phrase.split()}
        changing = {
            word
            for phrase, meanings in self.meanings.items()
            if any(meaning.kind in UNCORRECTABLE_KINDS for meaning in meanings)
            for word in phrase.split()
        }
        self.correctable = tuple(
            sorted(word for word in self.single - changing if len(word) >= MIN_CORRECTED_LETTERS)
        )
        """Words that a misspelt one may be taken for."""

    def role(self, group: str) -> Role:
        return self.assets[group].role


def load_vocabulary(extra: Path | str | None = None) -> Vocabulary:
    """The shipped vocabulary, preceded by that of a file if given.

    Raises SetupError with every fault of the file.
    """
    shipped = resources.files(__package__).joinpath("vocabulary.yaml").read_text(encoding="utf-8")
    documents = [read_document(shipped, VocabularyDocument, source="vocabulary.yaml")]
    if extra is not None:
        # First, because of two meanings of one kind the earlier document's holds.
        documents.insert(0, load_document(extra, VocabularyDocument))
    faults = [
        fault
        for document in documents
        for name, entry in document.assets.items()
        for asset in (entry.asset, *entry.kinds)
        if (fault := asset_fault(f"{extra}: assets.{name}", asset))
    ]
    known = set(documents[-1].assets) | set(documents[0].assets)
    faults += [
        Fault(
            f"{extra}: ambiguous.{word}",
            f"there is no asset {asset_words!r}",
            f"known: {', '.join(sorted(known))}",
        )
        for word, names in documents[0].ambiguous.items()
        for asset_words in names
        if asset_words not in known
    ]
    if faults:
        raise SetupError(faults)
    return Vocabulary(documents)


def _compiled(form: EventForm | RuleForm, signs: Mapping[str, str]) -> CompiledForm:
    """Raises SetupError for a pattern that is none, or that names an unknown sign."""

    def pattern(text: str) -> re.Pattern[str]:
        # Signs are made of signs; one that is made of itself would never end.
        for _ in range(MAX_SIGN_DEPTH):
            text = re.sub(r"@([A-Z_]+)", lambda match: f"(?:{signs[match.group(1)]})", text)
        # A line may break wherever a pattern has a space.
        text = re.sub(r" (?![^\[]*\])", r"\\s", text)
        return re.compile(rf"(?<![\w-])(?:{text})(?!\w)", re.IGNORECASE)

    try:
        patterns = [tuple(map(pattern, texts)) for texts in (form.all, form.also, form.none, form.context)]
    except (re.error, KeyError) as error:
        where = f"vocabulary: the form of {', '.join(form.sets) if isinstance(form, RuleForm) else form.kind}"
        raise SetupError(
            Fault(where, f"has no valid pattern: {error}", "see `signs` of the vocabulary")
        ) from error
    return CompiledForm(form, *patterns)


_ADJECTIVE = re.compile(r"[a-z]+ing|parked|stationary|static|halted|motionless|immobile")


def _plurals(word: str) -> Iterator[str]:
    yield word
    if word.endswith(("s", "x", "ch", "sh")):
        yield f"{word}es"
    elif word.endswith("y") and word[-2:-1] not in "aeiou":
        yield f"{word[:-1]}ies"
    yield f"{word}s"
    if word.endswith("man"):
        yield f"{word[:-3]}men"


def _meanings(document: VocabularyDocument) -> Iterator[tuple[str, Meaning]]:
    """Every phrase of a document with what it means, in the order in which meanings are tried."""
    yield from _things(document)
    for kind, units in document.units.items():
        yield from ((word, Meaning("UNIT", (kind, factor))) for word, factor in units.items())
    tables: dict[str, Mapping[str, object]] = {
        "PERAREA": document.per_area,
        "DIR": document.directions,
        "INTENSITY": document.intensities,
        "WINDS": document.winds,
        "SUN": document.suns,
        "CONCEAL": document.concealments,
        "AXIS": document.axes,
        "NTH": document.ordinals,
        "FRACTION": document.fractions,
    }
    for name, table in tables.items():
        yield from ((word, Meaning(name, value)) for word, value in table.items())
    yield from _described(document)
    yield from _bounds(document)
    for entry in document.fields:
        yield from ((word.lower(), Meaning("FIELD", entry)) for word in entry.words)
    for fixed in document.sets:
        yield from ((word.lower(), Meaning("SET", fixed)) for word in fixed.words)


def _things(document: VocabularyDocument) -> Iterator[tuple[str, Meaning]]:
    """Assets and numbers."""
    for group, asset in document.assets.items():
        yield from (
            (form, Meaning("ASSET", group)) for word in asset.words for form in _plurals(word.lower())
        )
    for word, groups in document.ambiguous.items():
        meaning = Meaning("ASSET", groups[0]) if len(groups) == 1 else Meaning("AMBIGUOUS", groups)
        yield from ((form, meaning) for form in _plurals(word.lower()))
    yield from ((word, Meaning("NUM", number)) for word, number in document.numbers.items())
    yield from ((word, Meaning("VAGUE", ends)) for word, ends in document.vague.items())


def _described(document: VocabularyDocument) -> Iterator[tuple[str, Meaning]]:
    """Weather, motions and the words of the grammar."""
    for weather in document.weather.values():
        yield from ((word, Meaning("WEATHER", weather)) for word in weather.words)
    for motion in document.motions.values():
        for word in motion.words:
            yield word, Meaning("MOTION", motion)
            # `walking civilians` and `a parked truck`; `they walk around the house` describes no house.
            if _ADJECTIVE.fullmatch(word):
                yield word, Meaning("MOVING", motion)
    for name, words in document.words.items():
        yield from ((word.lower(), Meaning(name)) for word in words)


def _bounds(document: VocabularyDocument) -> Iterator[tuple[str, Meaning]]:
    """Comparatives, and their opposites after a denial."""
    for bound, comparatives in document.bounds.items():
        opposite = "ATLEAST" if bound == "WITHIN" else "WITHIN"
        for word in comparatives:
            yield word, Meaning(bound)
            yield from ((f"{denial} {word}", Meaning(opposite)) for denial in document.denials)

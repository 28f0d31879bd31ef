"""The vocabulary: a document that users can extend, and the tables that the parser looks words up in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self, cast

from pydantic import Field, model_validator

from bench.documents import Document, load_document, read_document
from bench.errors import Fault, SetupError
from bench.simspec import ASSETS, Color, Identifier, Role, asset_fault

Words = tuple[str, ...]
Kind = Literal["LENGTH", "TIME", "SPEED", "ANGLE", "PERCENT", "AREA", "ENERGY"]


class AssetWords(Document):
    """Words for an asset. The key of the entry becomes the group's id in the SimSpec."""

    asset: Identifier
    role: Role = Field(cast(Any, None), validate_default=False, description="That of the asset when absent.")
    words: Words
    kinds: dict[Identifier, Words] = Field(
        {}, description="Assets that some of these words name more exactly, each with its words."
    )

    @model_validator(mode="after")
    def _role_of_the_asset(self) -> Self:
        if "role" not in self.model_fields_set and self.asset in ASSETS:
            # Frozen for everybody else; this completes the reading.
            self.__dict__["role"] = ASSETS[self.asset].role
        return self

    def named_by(self, noun: str) -> str:
        """The asset that a noun of `words` names."""
        return next(
            (asset for asset, words in self.kinds.items() if any(noun in plurals(word) for word in words)),
            self.asset,
        )


class WeatherWords(Document):
    """Words for a field of the environment; `level` when the word alone implies one."""

    path: str
    level: float | None = None
    words: Words


class MotionWords(Document):
    """Words for a motion, the speed that they imply, and whether they need a way."""

    kind: Literal["still", "wander"]
    speed_mps: float | None = None
    way: bool = False
    words: Words


class Adjectives(Document):
    """What stands before a noun: it gives the role, the concealment or the motion of a group."""

    role: dict[str, Role] = {}
    concealment: dict[str, float] = {}
    color: dict[str, Color] = {}
    motion: dict[str, str] = Field({}, description="A word, and the entry of `motions`.")


class Defaults(Document):
    """Numbers used when the prose gives none; each use is shown as a default."""

    near_m: float = Field(50.0, gt=0.0)
    exact_share: float = Field(
        0.1, gt=0.0, lt=1.0, description="A distance without a range may be off by this share."
    )
    road_width_m: float = Field(6.0, gt=0.0)
    area_east_m: float = Field(600.0, gt=0.0)
    area_north_m: float = Field(250.0, gt=0.0)
    ground_m: float = Field(100.0, gt=0.0, description="Side of named ground without a size.")
    uncertainty_m: float = Field(50.0, gt=0.0, description="Of intelligence that no sentence tells of.")


class VocabularyDocument(Document):
    """A vocabulary document. Every part is optional."""

    assets: dict[Identifier, AssetWords] = {}
    ambiguous: dict[str, Words] = Field({}, description="A word, and the assets that it may be.")
    adjectives: Adjectives = Adjectives()
    numbers: dict[str, float] = {}
    vague: dict[str, tuple[int, int]] = {}
    units: dict[Kind, dict[str, float]] = {}
    per_area: dict[str, float] = {}
    directions: dict[str, float] = {}
    axes: dict[str, float] = Field({}, description="How a road runs, in degrees below 180.")
    fractions: dict[str, float] = {}
    intensities: dict[str, float] = {}
    winds: dict[str, float] = {}
    weather: dict[str, WeatherWords] = {}
    suns: dict[str, Literal["rise", "set", "noon", "midnight"]] = {}
    motions: dict[str, MotionWords] = {}
    grounds: Words = Field((), description="Ground that has a name and no asset.")
    soft: Words = Field((), description="Words that free text may have and that change nothing.")
    people: Words = Field((), description="Words for whom the rules about bystanders protect.")
    motors: dict[str, int] = Field({}, description="How many motors a vehicle model has.")
    phrases: dict[str, str] = Field(
        {}, description="A pattern of free text, and the sentence of the controlled language for it."
    )
    defaults: Defaults | None = None


_TABLES = ("numbers", "vague", "per_area", "directions", "axes", "fractions", "intensities", "winds", "suns")


class Vocabulary:
    """The tables of one or more documents. The entries of an earlier document hold."""

    def __init__(self, documents: list[VocabularyDocument]) -> None:
        self.defaults = next((source.defaults for source in documents if source.defaults), Defaults())
        self.assets: dict[str, AssetWords] = {}
        self.motions: dict[str, MotionWords] = {}
        self.phrases: dict[str, str] = {}
        self.motors: dict[str, int] = {}
        self.tables: dict[str, dict[str, Any]] = {}
        for document in documents:
            self.assets = document.assets | self.assets
            self.motions = document.motions | self.motions
            self.phrases = document.phrases | self.phrases
            self.motors = document.motors | self.motors
            for name, entries in _tables_of(document).items():
                self._add(name, entries)
        for asset in ASSETS:
            names = (*plurals(asset), *plurals(asset.replace("-", " ")))
            self._add("noun", dict.fromkeys(names, self._entry_of(asset)))
        self._prefixes = {name: set(_prefixes(table)) for name, table in self.tables.items()}

    def _add(self, name: str, entries: Mapping[str, Any]) -> None:
        table = self.tables.setdefault(name, {})
        for word, value in entries.items():
            table.setdefault(word.lower(), value)

    def _entry_of(self, asset: str) -> str:
        """The entry of an asset of the catalogue, which each of them has."""
        return next(name for name, words in self.assets.items() if asset in (words.asset, *words.kinds))

    def role(self, group: str) -> Role:
        return self.assets[group].role

    def longest(self, name: str, words: list[str], at: int) -> list[tuple[Any, int]]:
        """The values of a table for the words from a place on, each with the place after them; the longest first."""
        table, prefixes = self.tables[name], self._prefixes[name]
        found: list[tuple[Any, int]] = []
        phrase = ""
        for end in range(at, len(words)):
            phrase = f"{phrase} {words[end]}" if phrase else words[end]
            if phrase not in prefixes:
                break
            if phrase in table:
                found.append((table[phrase], end + 1))
        return found[::-1]


def load_vocabulary(extra: Path | str | None = None) -> Vocabulary:
    """The shipped vocabulary, preceded by that of a file if given.

    Raises SetupError with every fault of the file.
    """
    shipped = resources.files(__package__).joinpath("vocabulary.yaml").read_text(encoding="utf-8")
    documents = [read_document(shipped, VocabularyDocument, source="vocabulary.yaml")]
    if extra is not None:
        # First, because of two meanings of one word the earlier document's holds.
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
            f"{extra}: ambiguous.{word}", f"there is no asset {name!r}", f"known: {', '.join(sorted(known))}"
        )
        for word, names in documents[0].ambiguous.items()
        for name in names
        if name not in known
    ]
    if faults:
        raise SetupError(faults)
    return Vocabulary(documents)


def plurals(word: str) -> Iterator[str]:
    """A noun and its plurals by rule."""
    yield word
    if word.endswith(("s", "x", "ch", "sh")):
        yield f"{word}es"
    elif word.endswith("y") and word[-2:-1] not in "aeiou":
        yield f"{word[:-1]}ies"
    yield f"{word}s"
    if word.endswith("man"):
        yield f"{word[:-3]}men"


def _prefixes(table: Iterable[str]) -> Iterator[str]:
    """The first words of every key, in every number."""
    for key in table:
        words = key.split()
        yield from (" ".join(words[:end]) for end in range(1, len(words) + 1))


def _tables_of(document: VocabularyDocument) -> dict[str, dict[str, Any]]:
    """The parts of a document as tables, by word."""
    tables: dict[str, dict[str, Any]] = {name: dict(getattr(document, name)) for name in _TABLES}
    for name in ("soft", "people"):
        tables[name] = {word: word for word in getattr(document, name)}
    adjectives = document.adjectives
    motions = {word: document.motions.get(entry) for word, entry in adjectives.motion.items()}
    return tables | {
        "noun": dict(_nouns_of(document)),
        "unit": {word: (kind, units[word]) for kind, units in document.units.items() for word in units},
        "weather": _by_word(document.weather),
        "motion": _by_word(document.motions),
        "ground": {word: word for word in document.grounds},
        "role": dict(adjectives.role),
        "concealment": dict(adjectives.concealment),
        "color": dict(adjectives.color),
        "moving": motions,
    }


def _by_word(entries: Mapping[str, WeatherWords | MotionWords]) -> dict[str, Any]:
    return {word: entry for entry in entries.values() for word in entry.words}


def _nouns_of(document: VocabularyDocument) -> Iterator[tuple[str, str | Words]]:
    """Every noun with its plurals, and the entry or entries that it may be."""
    for name, asset in document.assets.items():
        for words in (asset.words, *asset.kinds.values()):
            yield from ((form, name) for word in words for form in plurals(word.lower()))
    for word, names in document.ambiguous.items():
        yield from ((form, names) for form in plurals(word.lower()))

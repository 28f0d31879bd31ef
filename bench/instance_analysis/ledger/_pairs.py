"""Judges whether a sentence of the controlled language says what the words say that it stands for.

The parser has read the sentence in full. What is compared is what may go wrong in a rewrite: numbers and their order,
negations, conditions, bounds and shares, who and whom, directions, weather, and the subject of the sentence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bench.simspec import Role

from ..language._grammar import Part, Statement, forms
from ..language._phrases import NounPhrase
from ..language._quantities import Quantity
from ..language._vocabulary import MotionWords, Vocabulary, WeatherWords
from ._loads import HARD, Number, TextLoads, concepts

_RULES = tuple(form for section in forms().sections if section.title == "Rules" for form in section.forms)

_DENYING = ("only", "before", "dry", "calm")
"""Words that deny something without a `not`."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Words of a text, the sentence for them, and what the sentence was parsed to.

    `earlier` are the entries that the sentences before it name, the last ones last; `assumes` tells that the rewrite has
    declared an assumption, which a person will be asked about.
    """

    words: TextLoads
    sentence: TextLoads
    statements: tuple[Statement, ...]
    earlier: tuple[str, ...]
    assumes: bool
    vocabulary: Vocabulary

    @property
    def parts(self) -> list[Part]:
        return [part for statement in self.statements for part in (statement, *statement.predicates)]


def faults_of(pair: Pair) -> list[str]:
    """What the sentence says otherwise than its words; nothing when it says the same."""
    return [fault for check in _CHECKS for fault in check(pair)]


def _numbers(pair: Pair) -> Iterator[str]:
    """The same numbers in the same order, each with the thing that it counts."""
    unmatched = list(pair.words.numbers)
    matched: list[tuple[Number, Number]] = []
    for number in pair.sentence.numbers:
        same = _same_number(number, unmatched)
        if same is None and _same_number(number, pair.words.known) is None:
            yield f"the number {_shown(number)} is not in the words"
        elif same is not None:
            unmatched.remove(same)
            matched.append((same, number))
    yield from (f"the number {_shown(number)} of the words is lost" for number in unmatched)
    yield from _misplaced(matched)


def _same_number(number: Number, others: Sequence[Number]) -> Number | None:
    """The number of the words that a number of the sentence is; if it can be, one that counts the same thing."""
    alike = [other for other in others if number.is_like(other)]
    return next((other for other in alike if other.thing == number.thing), next(iter(alike), None))


def _misplaced(matched: Sequence[tuple[Number, Number]]) -> Iterator[str]:
    """Numbers in another order, or that count something else."""
    for kind in {number.kind for number, _ in matched}:
        starts = [words.span.start for words, number in matched if number.kind == kind]
        if starts != sorted(starts):
            yield "its numbers stand in another order than those of the words"
    for words, number in matched:
        if words.thing and number.thing and words.thing != number.thing:
            yield f"{words.value:g} counts a {words.thing} in the words, and a {number.thing} in the sentence"


def _shown(number: Number) -> str:
    return f"{number.value:g} ({number.kind.lower()})"


def _loads(pair: Pair) -> Iterator[str]:
    """The same negations, conditions, shares, alternatives and quantifiers, but those that a form has in itself."""
    may_be_lost, may_be_added = _allowed_loads(pair)
    words, sentence = pair.words.counted(), pair.sentence.counted()
    for kind in sorted(HARD):
        if words[kind] > sentence[kind] and kind not in may_be_lost:
            yield f"{_first_load(pair.words, kind)!r} of the words is lost"
        if sentence[kind] > words[kind] and kind not in may_be_added:
            yield f"the words have nothing like {_first_load(pair.sentence, kind)!r}"
    if words["aside"]:
        yield "the words speak of another occasion"


def _allowed_loads(pair: Pair) -> tuple[set[str], set[str]]:
    """The loads that the words may have more of than the sentence, and those that the sentence may have more of."""
    carried = _carried(pair)
    # `stay below 100 m` is `never above 100 m`.
    turned = _directions_of_bounds(pair.words) & _directions_of_bounds(pair.sentence)
    denies = pair.words.counted()["negation"] or turned or pair.assumes or pair.words.has(_DENYING)
    lost = carried | ({"negation"} if turned else set())
    return lost, lost if denies else lost - {"negation"}


def _carried(pair: Pair) -> set[str]:
    """The loads that the forms of the sentence have in themselves."""
    carried = {load for part in pair.parts for load in part.form.carries}
    counts, about_people = _counts(pair), _protects(pair)
    holds = {
        "upper": any(part.form.order for part in pair.parts),
        # `drawn from {1, 4, 9}`.
        "alternative": any(count.values for count in counts if count is not None),
        # `each sortie starts at noon`, `every report`: only of groups it tells how many. `one of the helpers`: anybody of
        # those whom a rule protects. `the latter`: asked, where the rewrite says so.
        "quantifier": not counts or about_people or pair.assumes,
        "share": about_people or pair.assumes,
    }
    carried |= {load for load, is_carried in holds.items() if is_carried}
    return carried | ({"lower", "upper"} if _is_range(pair) else set())


def _counts(pair: Pair) -> list[Quantity | None]:
    """How many each subject of the sentence is."""
    return [phrase.count for part in pair.parts if isinstance(part, Statement) for phrase in part.subjects]


def _is_range(pair: Pair) -> bool:
    """Whether the words say a range by its ends: `minimum 30 and maximum 45`."""
    words = pair.words.counted()
    return bool(words["lower"] and words["upper"]) and not pair.sentence.counted()["lower"]


def _protects(pair: Pair) -> bool:
    """Whether the sentence is a rule about people."""
    return any(part.first("people") for part in pair.parts)


def _first_load(text: TextLoads, kind: str) -> str:
    return next(load.text for load in text.loads if load.kind == kind)


def _bounds(pair: Pair) -> Iterator[str]:
    """Bounds in the same direction, a denial turned around."""
    words, sentence = _directions_of_bounds(pair.words), _directions_of_bounds(pair.sentence)
    if words and sentence and words.isdisjoint(sentence):
        yield "the bound of the words is turned around"


def _directions_of_bounds(text: TextLoads) -> set[str]:
    denied = any(load.kind == "negation" for load in text.loads)
    turned = {"lower": "upper", "upper": "lower"}
    return {turned[load.kind] if denied else load.kind for load in text.loads if load.kind in turned}


def _topics(pair: Pair) -> Iterator[str]:
    """The subject of each form must be in the words."""
    for part in pair.parts:
        wanted = [*part.form.topic, *(("rule",) if part.form in _RULES else ()), *_topics_of_slots(part)]
        missing = [topic for topic in wanted if not pair.words.has(concepts().topics[topic])]
        if pair.assumes and (len(missing) < len(wanted) or _tell_something(pair)):
            # What the rewrite declares is asked: `the duty officer must agree` is consent. `Cheers, Paul` is nothing.
            continue
        yield from (f"the words do not speak of {topic.replace('_', ' ')}" for topic in missing)


def _topics_of_slots(part: Part) -> Iterator[str]:
    for capture in part.captures:
        if isinstance(capture.value, MotionWords):
            yield capture.value.kind
        elif isinstance(capture.value, WeatherWords):
            yield capture.value.path.split(".")[1].removesuffix("_level")


def _tell_something(pair: Pair) -> bool:
    """Whether the words and the sentence have anything in common: a number, a thing, people, or a colour."""
    named = {entry for entry, _ in pair.sentence.things()}
    meant = named & {entry for entry, _ in pair.words.things()} or (
        named and pair.words.has(concepts().pronouns)
    )
    people = _protects(pair) and _means_people(pair)
    return bool(pair.words.numbers or meant or people or pair.words.table("color"))


def _weather(pair: Pair) -> Iterator[str]:
    """No kind of weather is lost, and no intensity is added or changed."""
    if pair.sentence.has(["visibility"]):
        return
    for name in ("rain", "fog", "dust"):
        words = [word for word in concepts().topics[name] if word.startswith(name)]
        if pair.words.has(words) and not pair.sentence.has(concepts().topics[name]):
            yield f"the {name} of the words is lost"
    of_words, of_sentence = (
        set(pair.words.table("intensities")) - {0},
        set(pair.sentence.table("intensities")) - {0},
    )
    if (
        pair.words.has(["rain*", "fog*", "wind*", "mist*", "dust*"]) and of_words != of_sentence
    ) and not pair.assumes:
        yield "the strength of the weather is another one"


def _compass(pair: Pair) -> Iterator[str]:
    """The same directions of the compass."""
    words, sentence = _directions(pair.words), _directions(pair.sentence)
    if sorted(words) != sorted(sentence):
        yield "its directions are not those of the words"


def _directions(text: TextLoads) -> list[float]:
    """Directions in degrees. A letter behind a number is a unit, and one in brackets a part of coordinates."""
    directions: list[float] = []
    for at in range(len(text.words)):
        letter = len(text.words[at]) < 2 and (at == 0 or text.tokens[at - 1].kind == "number")
        if not letter and (direction := text.direction(at)) is not None:
            directions.append(direction)
    return directions


def _colors(pair: Pair) -> Iterator[str]:
    """The same colours, where the sentence tells of things."""
    if any(isinstance(part, Statement) and part.subjects for part in pair.parts):
        words, sentence = set(pair.words.table("color")), set(pair.sentence.table("color"))
        yield from (f"the words do not say {color!r}" for color in sorted(map(str, sentence - words)))
        yield from (f"{color!r} of the words is lost" for color in sorted(map(str, words - sentence)))


def _things(pair: Pair) -> Iterator[str]:
    """Every thing of the sentence comes from the words, or is meant by a pronoun of theirs."""
    of_words: dict[str, set[str]] = {}
    for entry, asset in pair.words.things():
        of_words.setdefault(entry, set()).add(asset)
    for entry, asset in pair.sentence.things():
        if entry not in of_words:
            yield from _not_named(entry, pair)
        elif asset not in {*of_words[entry], pair.vocabulary.assets[entry].asset}:
            # A noun of the same entry that says more than the words: a woman is not any person.
            yield f"the words do not say {asset!r}"
    # `box` is a crate, and the area of interest.
    if not (pair.assumes or _protects(pair) or any(part.form.does == "area" for part in pair.parts)):
        yield from _lost_things(pair)


def _lost_things(pair: Pair) -> Iterator[str]:
    named = {entry for entry, _ in pair.sentence.things()}
    lost = [noun for nouns, noun in pair.words.nouns() if named.isdisjoint(nouns)]
    yield from (f"{noun!r} of the words is lost" for noun in lost)


def _means_people(pair: Pair) -> bool:
    """Whether the words speak of people, by a noun or a pronoun."""
    if pair.words.table("people") or pair.words.has(concepts().pronouns):
        return True
    return any(pair.vocabulary.role(entry) is Role.BYSTANDER for entry, _ in pair.words.things())


def _not_named(entry: str, pair: Pair) -> Iterator[str]:
    """A thing that the words do not name: a pronoun may mean the last one of the sentences before."""
    if _protects(pair) and _means_people(pair):
        return
    is_meant = pair.words.has(concepts().pronouns) and entry in pair.earlier[-1:]
    if pair.assumes or is_meant:
        return
    if entry not in pair.earlier:
        yield f"no {entry} is in the words, nor in a sentence before: say whom they mean in taken_to_mean"
    else:
        yield f"the words do not name the {entry}: say whom they mean in taken_to_mean"


def _roles(pair: Pair) -> Iterator[str]:
    """The same roles, but where the asset has the role by itself."""
    natural = {pair.vocabulary.role(entry) for entry, _ in pair.sentence.things()}
    of_words, of_sentence = set(pair.words.roles()), set(_written_roles(pair))
    known = set(pair.words.table("role")) | natural
    searched = pair.words.has(concepts().topics["role"])
    for role in of_sentence - known:
        if not pair.assumes and not (searched and role in (Role.SOUGHT, Role.ADVERSARY)):
            yield f"the words do not say {role}"
    called = any("role" in part.form.topic for part in pair.parts)
    yield from (
        f"{role} of the words is lost"
        for role in of_words - of_sentence - natural - set(pair.sentence.table("role"))
        if not called
    )


def _written_roles(pair: Pair) -> Iterator[Role]:
    """The roles that the sentence gives to its groups."""
    for part in pair.parts:
        phrases = [
            *(part.subjects if isinstance(part, Statement) else ()),
            *(capture.value for capture in part.captures),
        ]
        for phrase in phrases:
            if isinstance(phrase, Role):
                yield phrase
            elif isinstance(phrase, NounPhrase):
                yield from (value for name, value in phrase.adjectives if name == "role")


def _order(pair: Pair) -> Iterator[str]:
    """Who stands by whom: the things in the same order, unless the verb of the words turns them around."""
    words = [entry for entry, _ in pair.words.things()]
    sentence = [entry for entry, _ in pair.sentence.things()]
    common = [entry for entry in words if (words.count(entry), sentence.count(entry)) == (1, 1)]
    related = any(part.first("reference") is not None for part in pair.parts)
    turned = common != [entry for entry in sentence if entry in common]
    if related and turned and not pair.words.has(concepts().passives):
        yield "who and whom are exchanged"


_CHECKS: Sequence[Callable[[Pair], Iterator[str]]] = (
    _numbers, _loads, _bounds, _topics, _weather, _compass, _colors, _things, _roles, _order,
)  # fmt: skip

"""Nothing is read in silence: what a number, a negation, a condition or a quantifier does to known sentences.

Random texts are put together of sentences that are read right, with one insert each that changes what the
sentence says. The document must change as the insert says, or the clause must be listed or be a choice.
"""

from __future__ import annotations

import random
from typing import Any

import pytest

from bench.instance_analysis import BaseSimSpec, load_vocabulary, read_prose
from bench.instance_analysis.ledger._loaded_words import Load, loaded_words

VOCABULARY = load_vocabulary()
SENTENCES: dict[str, dict[str, Any]] = {
    "A radar vehicle.": {"actors[radar].count": 1},
    "Two trucks on the road.": {"actors[truck].count": 2, "actors[truck].placement.along.where": "on"},
    "Five civilians walk within 40 m of a shed.": {
        "actors[civilian].count": 5,
        "actors[civilian].motion.kind": "wander",
        "actors[civilian].placement.near.max_m": 40.0,
    },
    "Three soldiers, 20 to 30 m from a house.": {
        "actors[soldier].placement.near.min_m": 20.0,
        "actors[soldier].placement.near.max_m": 30.0,
    },
    "Light rain.": {"environment.rain_level": 2.0},
    "Wind 5 m/s from the west.": {"environment.wind.speed_mps": 5.0, "environment.wind.from_deg": 270.0},
    "Fly at 70 m and 9 m/s.": {"mission.altitude_m": 70.0, "mission.speed_mps": 9.0},
    "Time limit 8 minutes.": {"mission.time_limit_s": 480.0},
    "Do not mark within 60 m of civilians.": {"rules.no_mark_within_m": 60.0},
    "GPS jammed at 100 s for 20 s.": {
        "vehicle.failures[0].at_s": 100.0,
        "vehicle.failures[0].duration_s": 20.0,
    },
}
"""Sentences that are read in full, with the fields that each of them sets."""
TURNING = (
    "if",
    "unless",
    "when",
    "not",
    "never",
    "without",
    "half of the",
    "one of the",
    "either",
    "or",
    "instead of",
)
"""Inserts after which the sentence says something else, so that its fields may not stand as they were."""
BESIDE = ("each", "7", "seven", "at least", "twice", "per", "2.5")
"""Inserts that nobody can use where they stand."""
BEFORE_DRONE = {"mission.altitude_m": 60.0, "mission.speed_mps": 12.0, "mission.time_limit_s": 300.0}
SOMEBODY_ELSES_NUMBERS = [
    "A fence of 45 m.", "Somebody has 25 goats.", "The river is 15 m deep.", "They arrived 300 s ago, perhaps.",
    "The gate opens for 90 s.", "A flag at 33 m.", "The crowd moves with 17 m/s of joy.", "A bus, 12 minutes late.",
    "The radar hums, at 37 m.", "Trucks weigh 8 tonnes; within 400 s nothing happens.",
]  # fmt: skip


def values(result: BaseSimSpec) -> dict[str, Any]:
    return {receipt.path: receipt.value for receipt in result.receipts}


def visible(result: BaseSimSpec, start: int, end: int) -> bool:
    """Whether something within a stretch of the text is listed, or a choice."""
    unread = [(passage.start, passage.end) for passage in (*result.not_understood, *result.not_expressible)]
    choices = [(choice.start, choice.end) for choice in result.choices]
    return any(begin < end and start < stop for begin, stop in (*unread, *choices))


@pytest.mark.parametrize("sentence", SENTENCES)
def test_the_sentences_are_read_in_full_without_an_insert(sentence: str) -> None:
    """What the random texts are made of is certain by itself."""
    result = read_prose(sentence, VOCABULARY)
    assert result.complete
    assert {path: values(result)[path] for path in SENTENCES[sentence]} == SENTENCES[sentence]


@pytest.mark.parametrize("seed", range(6))
def test_no_insert_is_ever_passed_over(seed: int) -> None:
    """Any insert at any place between two words of any sentence is visible, or changes the document."""
    draw = random.Random(seed)
    for _ in range(40):
        sentences = draw.sample(list(SENTENCES), 3)
        at = draw.randrange(3)
        words = sentences[at].removesuffix(".").split()
        place = draw.randint(0, len(words))
        insert = draw.choice((*TURNING, *BESIDE))
        changed = " ".join((*words[:place], insert, *words[place:])) + "."
        begin = sum(len(sentence) + 1 for sentence in sentences[:at])
        text = " ".join((*sentences[:at], changed, *sentences[at + 1 :]))
        result, before = read_prose(text, VOCABULARY), read_prose(" ".join(sentences), VOCABULARY)
        told = (
            values(result) | {"description": ""} != values(before) | {"description": ""}
            or result.ranges != before.ranges
        )
        assert visible(result, begin, begin + len(changed)) or told, text


@pytest.mark.parametrize("word", TURNING)
@pytest.mark.parametrize("sentence", SENTENCES)
def test_what_turns_a_sentence_around_leaves_no_field_of_it_unseen(sentence: str, word: str) -> None:
    """A field of a sentence that is denied, conditional or said of some is not set, or the sentence is a
    choice.
    """
    text = f"A tree. {word.capitalize()} {sentence[0].lower()}{sentence[1:]}"
    result = read_prose(text, VOCABULARY)
    kept = [path for path, value in SENTENCES[sentence].items() if values(result).get(path) == value]
    assert not kept or visible(result, 8, len(text)), (text, kept)


@pytest.mark.parametrize("text", SOMEBODY_ELSES_NUMBERS)
def test_a_number_that_nobody_claims_is_no_number_of_the_drone(text: str) -> None:
    """Height, speed and time limit stay as they are, and the number is listed or a choice."""
    result = read_prose(f"Two trucks. {text} A shed.", VOCABULARY)
    assert {path: values(result)[path] for path in BEFORE_DRONE} == BEFORE_DRONE
    assert visible(result, 12, 12 + len(text))


@pytest.mark.parametrize(
    "text",
    [
        "If more than two civilians come within 20 m of the radar, fly at 90 m.",
        "When it rains, six soldiers stand near the radar.",
        "There are four children near the radar unless it rains.",
        "Hold, if the wind exceeds 8 m/s.",
        "No flying below 40 m.",
        "Flying below 40 m is forbidden.",
        "The drone must not be at 35 m.",
    ],
)
def test_a_condition_places_nothing_and_sets_nothing(text: str) -> None:
    """What a condition or a prohibition speaks of is not in the document, and is listed."""
    before, result = read_prose("A radar.", VOCABULARY), read_prose(f"A radar. {text}", VOCABULARY)
    different = {path for path, value in values(result).items() if values(before).get(path) != value}
    assert {path for path in different if not path.startswith("rules.")} <= {"description"}
    assert visible(result, 9, 9 + len(text)) or different > {"description"}


@pytest.mark.parametrize(
    ("text", "loads"),
    [
        ("None of the 3 trucks moves if it rains.", [Load.NEGATION, Load.NUMBER, Load.CONDITION]),
        ("twenty-six or half", [Load.NUMBER, Load.ALTERNATIVE, Load.SHARE]),
        ("km2 notable ifs orchard", []),
    ],
)
def test_loaded_words_are_found_in_the_text_itself(text: str, loads: list[Load]) -> None:
    """Whole words alone, whatever the vocabulary makes of them."""
    assert [word.load for word in loaded_words(text)] == loads


def test_a_number_is_used_once() -> None:
    """What repeats a number that is known is read; another number for the same group is not."""
    same = read_prose("Five trucks. The five trucks are camouflaged.", VOCABULARY)
    other = read_prose("Five trucks. The three trucks are camouflaged.", VOCABULARY)
    assert same.complete
    assert [choice.quote for choice in other.choices] == ["The three trucks are camouflaged"]


@pytest.mark.parametrize(
    "word", ["fug", "heave", "sunder", "marked", "talk", "rail", "hose", "walling", "wing"]
)
def test_no_english_word_is_mended(word: str) -> None:
    """A word of English is listed as it is, however near it is to one of the vocabulary."""
    assert not read_prose(f"A radar. The {word}.", VOCABULARY).corrected


@pytest.mark.parametrize("word", ["sunst", "hevy", "walkng", "rainn", "foggg", "moonligt", "winddy"])
def test_no_word_of_weather_light_or_motion_is_mended(word: str) -> None:
    """Such a correction would change the scene, and hardly be seen."""
    assert not read_prose(f"A radar, {word}.", VOCABULARY).corrected


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("The system under test finds one radar vehicle.", "actors[radar].count", 1),
        ("A man left the house. He walks.", "actors[civilian].motion.kind", "wander"),
        ("Six men stand near a house. They walk around the house.", "actors[house].motion.kind", "still"),
        ("Three soldiers guard a truck parked on the road.", "actors[truck].placement.along.where", "on"),
        ("Children; there are 20 of them.", "actors[child].count", 20),
        ("The area is 0,5 km by 0,3 km.", "world.area.corners[2].east_m", 250.0),
        ("A truck two nautical miles from a house.", "actors[truck].placement.near.max_m", 2 * 1852 * 1.1),
        (
            "The UAV shall not mark a target while civilians are within 45 m of it.",
            "rules.no_mark_within_m",
            45.0,
        ),
        ("If the C2 link is lost for more than 7 s, the UAV shall return.", "rules.link_lost_after_s", 7.0),
        ("Marking is only allowed when no civilian is within 35 m.", "rules.no_mark_within_m", 35.0),
    ],
)
def test_what_was_read_wrong_without_a_word_is_read(text: str, path: str, value: Any) -> None:
    """Numbers beside a far bound, pronouns, verbs before a thing, attachments, rules in other orders."""
    assert values(read_prose(text, VOCABULARY))[path] == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "quote"),
    [
        ("Missing person search. A radar.", "person"),
        ("A truck. Its position is 4 minutes old; a second report has priority 2.", "priority 2"),
        ("Of the 12 civilians, 4 are children.", "Of the 12 civilians"),
        ("Some radars, one of which is camouflaged.", "one of which"),
        ("Two soldiers near a truck, camouflaged.", "camouflaged"),
        ("A radar. 25 m away, a shed.", "25 m away"),
    ],
)
def test_what_a_sentence_does_not_tell_is_a_choice(text: str, quote: str) -> None:
    """Whom a word means, whether a thing is there, and what a share leaves."""
    assert any(quote in choice.quote for choice in read_prose(text, VOCABULARY).choices)

"""The ledger between words and the sentence for them: planted errors are seen, and true sentences pass."""

from __future__ import annotations

import pytest

from bench.instance_analysis import Rewrite, load_vocabulary
from bench.instance_analysis.rewriting._rewrite import RewriteJudge

VOCABULARY = load_vocabulary()
Row = tuple[str, str, str]
"""What the text has named before in controlled sentences, the words, and the sentence for them."""


def faults(row: Row) -> list[tuple[str, str]]:
    """What the judge says of the words and their sentence; the sentences before them stand for themselves."""
    before, words, sentence = row
    pairs = [{"quotes": [part], "sentence": f"{part}."} for part in before.split(". ") if part]
    pairs.append({"quotes": [words], "sentence": sentence})
    text = f"{before}. {words}." if before else f"{words}."
    return RewriteJudge(text, VOCABULARY).judge(Rewrite.model_validate({"pairs": pairs})).faults


TRUE: list[Row] = [
    ("", "we have got a mobile radar sitting at (120, -40)", "A radar at (120, -40)."),
    ("", "somewhere between five and ten villagers", "Between 5 and 10 civilians."),
    ("A truck", "five villagers hang around, no more than 60 m from it", "Five civilians within 60 m of the truck."),
    ("A house", "three riflemen, none nearer than 40 m to the house", "Three soldiers at least 40 m from the house."),
    ("", "no marking if anyone innocent is within 40 m", "Do not mark within 40 m of civilians."),
    ("", "the UAV has to keep 30 m clear of any bystander", "Keep at least 30 m away from people."),
    ("", "never get above 200 ft", "The drone must not fly above 200 ft."),
    ("", "stay below 90 m", "Maximum height 90 m."),
    ("", "eight minutes tops", "Time limit eight minutes."),
    ("", "wind out of the west at 12 knots", "Wind 12 knots from the west."),
    ("", "it's foggy, level 3", "Fog level 3."),
    ("", "there is no rain at all", "No rain."),
    ("", "at t = 70 s the satellite navigation is jammed for 20 s", "At 70 s GPS jammed for 20 s."),
    ("", "the operator's radio is down from 60 s to 90 s", "From 60 s to 90 s the operator link is down."),
    ("", "after 45 s he orders it to hold", "At 45 s the operator orders hold."),
    ("", "two hikers have gone missing", "Two missing civilians."),
    ("", "we are looking for two women", "Two missing women."),
    ("", "two enemy vans are parked", "Two enemy vans are parked."),
    ("A radar", "the tip on the radar is ten minutes old and good to 75 m", "Intelligence on the radar, ten minutes old, accurate to 75 m."),
    ("", "mark only with the operator's permission", "No marking without the consent of the operator."),
    ("", "if comms drop for longer than 15 seconds, come home", "If the link is lost for more than 15 s, return home."),
    ("", "cruise at 130 ft", "Fly at 130 ft."),
    ("", "twelve cows graze in the north", "12 cows in the northern part."),
    ("", "a quarter of the charge must be left when it lands", "Battery reserve a quarter."),
    ("", "it starts with a battery at 90 %", "Battery at 90 %."),
    ("", "six civilians stroll along at 5 km/h", "Six civilians walk at 5 km/h."),
    ("A road", "two trucks are parked beside the road", "Two trucks are parked beside the road."),
    ("A shed", "a sniper hidden from the shed", "A soldier hidden from the shed."),
    ("", "kick-off is 14:30 UTC on 3 March 2026", "Start at 14:30 UTC on 3 March 2026."),
    ("", "motor 2 quits at 150 s", "Motor 2 fails at 150 s."),
    ("", "the pack drops to 30 % at 150 s", "The battery drops to 30 % at 150 s."),
]  # fmt: skip

PLANTED: dict[str, list[Row]] = {
    "number": [
        ("", "five villagers stand about", "Six civilians."),
        ("", "cruise at 130 ft", "Fly at 120 ft."),
        ("", "wind out of the west at 12 knots", "Wind 15 knots from the west."),
    ],
    "unit": [
        ("", "cruise at 130 ft", "Fly at 130 m."),
        ("", "eight minutes tops", "Time limit 8 s."),
        ("", "wind out of the west at 12 knots", "Wind 12 m/s from the west."),
    ],
    "negation": [
        ("A truck", "the truck is not camouflaged", "The truck is camouflaged."),
        ("", "mark when people are within 30 m", "Do not mark within 30 m of people."),
        ("", "the drone does not return home", "Return home."),
    ],
    "role": [
        ("", "two vans are parked", "Two enemy vans are parked."),
        ("", "two hostile pickups", "Two pickups."),
        ("", "three hikers rest", "Three missing civilians."),
    ],
    "condition": [
        ("", "hold at 40 s if it rains", "At 40 s the operator orders hold."),
        ("", "five civilians unless the market is closed", "Five civilians."),
        ("", "fly at 80 m when the link is up", "Fly at 80 m."),
    ],
    "bound": [
        ("A truck", "five civilians at least 60 m from the truck", "Five civilians within 60 m of the truck."),
        ("", "never go below 40 m", "The drone must not fly above 40 m."),
        ("", "not more than 8 soldiers", "At least 8 soldiers."),
    ],
    "swapped numbers": [
        ("", "cruise at 80 m, but never get above 100 m", "Fly at 100 m. The drone must not fly above 80 m."),
        ("", "five men and three women", "Three men. Five women."),
        ("", "the link is down at 60 s for 30 s", "Operator link down at 30 s for 60 s."),
    ],
    "cut range": [
        ("", "five to ten villagers", "Five civilians."),
        ("A truck", "three soldiers 20 to 40 m from the truck", "Three soldiers 40 m from the truck."),
        ("", "fog level 2 to 5", "Fog level 2."),
    ],
    "rule made of an event": [
        ("", "the drone flew 30 m away from people yesterday", "Keep at least 30 m away from people."),
        ("", "the operator orders return at 90 s", "If the link is lost, return home."),
        ("", "last week it marked nothing within 50 m of civilians", "Do not mark within 50 m of civilians."),
    ],
    "direction": [
        ("", "wind out of the west at 12 knots", "Wind 12 knots from the east."),
        ("A house", "a truck north of the house", "A truck south of the house."),
        ("", "twelve cows graze in the north", "12 cows in the southern part."),
    ],
    "weather": [
        ("", "it's foggy, level 3", "Rain level 3."),
        ("", "light rain", "Heavy rain."),
        ("", "no rain and no fog", "No rain."),
    ],
    "invented sentence": [
        ("", "cheers, Paul", "Fixed wing."),
        ("", "the coffee is good here", "A radar."),
        ("", "see you on Monday", "Return home."),
    ],
    "referent": [
        ("A truck. A house", "five civilians within 60 m of the house", "Five civilians within 60 m of the truck."),
        ("A truck. A house", "five civilians within 60 m of it", "Five civilians within 60 m of the truck."),
        ("A radar. A shed", "a soldier stands near the shed", "A soldier near the radar."),
    ],
    "who and whom": [
        ("A truck. Three soldiers", "the soldiers stand within 20 m of the truck", "The truck is within 20 m of the soldiers."),
        ("A bus. A house", "the bus is north of the house", "The house is north of the bus."),
        ("A shed. A tree", "the tree stands at least 20 m from the shed", "The shed stands at least 20 m from the tree."),
    ],
    "share": [
        ("Ten civilians", "half of them walk", "They walk."),
        ("Ten civilians", "three of the civilians are near home", "The civilians are near home."),
        ("Six soldiers", "each of the soldiers is at least 30 m from home", "A soldier is at least 30 m from home."),
    ],
}  # fmt: skip


def test_planted_errors_are_seen() -> None:
    """Of fifteen kinds with three carriers each, at least fourteen whatever carries them."""
    missed = {kind: [row[1:] for row in rows if not faults(row)] for kind, rows in PLANTED.items()}
    missed = {kind: rows for kind, rows in missed.items() if rows}
    assert len(PLANTED) == 15
    assert all(len(rows) == 3 for rows in PLANTED.values())
    assert len(missed) <= 1, missed


def test_true_sentences_pass() -> None:
    """At most one in ten is refused."""
    refused = [(row, faults(row)) for row in TRUE if faults(row)]
    assert len(TRUE) >= 30
    assert len(refused) <= len(TRUE) // 10, refused


@pytest.mark.parametrize(
    ("words", "sentence", "why"),
    [
        ("cruise at 130 ft", "Fly high.", "is no sentence of the page"),
        ("cruise at 999 ft", "Fly at 999 ft.", "the quote is not in the text"),
        ("cruise", "Fly at 130 ft.", "the number 39.624 (length) is not in the words"),
    ],
)
def test_a_sentence_without_words_is_refused(words: str, sentence: str, why: str) -> None:
    """It must be read in full, quote the text, and say no more."""
    rewrite = Rewrite.model_validate({"pairs": [{"quotes": [words], "sentence": sentence}]})
    judged = RewriteJudge("Please cruise at 130 ft.", VOCABULARY).judge(rewrite)
    assert any(why in fault for _, fault in judged.faults)


def test_every_load_of_the_text_stands_in_one_quote() -> None:
    """A number that is left out is told, and one that is quoted twice is refused."""
    text = "Cruise at 130 ft, unless it rains. Five men."
    told = dict(RewriteJudge(text, VOCABULARY).judge(Rewrite(pairs=())).faults)
    assert set(told) == {"130 ft", "unless", "Five"}
    twice = {"quotes": ["Five men"], "sentence": "Five men."}
    judged = RewriteJudge(text, VOCABULARY).judge(Rewrite.model_validate({"pairs": [twice, twice]}))
    assert ("Five men", "the quote is not in the text, or is quoted twice") in judged.faults


@pytest.mark.parametrize(
    ("words", "sentence"), [("cheers, Paul", "Fixed wing."), ("the coffee is good here", "Return home."), ("fly at 80 m", "Fly at 90 m."), ("two vans", "A red van."), ("wind from the west", "Wind from the east at 5 m/s.")]
)  # fmt: skip
def test_an_assumption_lets_no_planted_error_pass(words: str, sentence: str) -> None:
    """It may name what the words mean, and add neither numbers, colours and directions nor a subject out of nothing."""
    pair = {"quotes": [words], "sentence": sentence, "taken_to_mean": "what is meant"}
    judge = RewriteJudge(f"{words}.", VOCABULARY)
    assert judge.judge(Rewrite.model_validate({"pairs": [pair]})).faults

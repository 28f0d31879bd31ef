"""Finds the clauses that are one rule or one limit, whatever the order of their words.

`The UAV shall not mark a target while a civilian is within 50 m of it`: rules are written in too many orders for a
grammar. The vocabulary lists what each needs, its signs and its numbers. A rule is read only from clauses in which
it holds every number, denial, condition and bound, and which speak of nothing else.
"""

from __future__ import annotations

import re
from dataclasses import replace

from bench.simspec import Role

from ..language._phrases import Part, Phrase
from ..language._tokens import Span
from ..language._vocabulary import RuleForm
from ..ledger._loaded_words import Load, LoadedWord
from ._clause_runs import EXCEPTION, Run, SentenceRuns, blanked, overlap

FOREIGN_KINDS = frozenset(
    ["POINT", "CLOCK", "DATE", "AREA", "DIM", "SUN", "WEATHER", "WIND", "GUSTS", "GROUND", "NAMED", "NOFLY", "ROAD", "SET", "CONCEAL"]
)  # fmt: skip
"""Kinds of words that no rule holds: a clause with one of them is about something else."""
MAX_RUN = 5
"""Clauses that a rule may stretch over at most, so that the search stays linear. Chosen, not measured."""
_HEIGHTS = frozenset(["rules.max_altitude_m", "rules.min_altitude_m"])
_ABOVE_HOME = re.compile(
    r"\babove\s+(?:the\s+)?(?:home|launch|ground|start|take-?off|sea|mean|point)\b(?:\s+(?:point|level|sea\s+level))?",
    re.IGNORECASE,
)
"""What a height is measured from, which is no lower limit."""
_UNREAD = re.compile(
    r"\b(?:unless|except|instead|(?:until|before)(?!\s+(?:t\b|\d|second|minute|(?:it|the\s+link)\s+(?:comes|is)\b)))",
    re.IGNORECASE,
)
"""What no rule of the SimSpec can hold: such a clause is not read here."""
_HAPPENS = re.compile(r"['’]s\b|\b(?:is|are|be|has|have|been|comes?|gets?|goes)\b", re.IGNORECASE)
_FORBIDS = re.compile(r"\bmark\w*\b|\bnot\b|n['’]t\b|\bnever\b", re.IGNORECASE)
_PERSONS = re.compile(
    r"\b(?:any|some|every|no)(?:one|body)\b|\bno-one\b|\bhumans?\b|\bcivs?\b|(?:\b(?:any|one|each|either)\s+)?\bof (?:one|them)\b(?! of)",
    re.IGNORECASE,
)
_PRONOUN = re.compile(
    r"\b(?:them|him|her|whose|their|one|(?:when|if|while)\s+(?:they|these))\b|^(?:and\s+)?(?:keep|stay|remain)s?\s+(?:at least\s+)?\S+\s?\w*\s+(?:away|clear|off|back)$",
    re.IGNORECASE,
)
"""What may mean the persons that the text has just named."""
_NO_BYSTANDERS = re.compile(r"\b(?:hostile|enem\w+|armed|target\w*|escort\w*|convoy)\b", re.IGNORECASE)
_ANYBODY = frozenset(["any", "all", "every"])


def rules_in(sentence: SentenceRuns) -> tuple[list[Phrase], set[int]]:
    """The rules of a sentence, and the numbers of the clauses that they hold."""
    conditional = any(word.load is Load.CONDITION for word in sentence.loaded)
    # A condition belongs to all that it may reach; without one each clause is read by itself, if it can be.
    lengths = sorted(range(1, min(MAX_RUN, len(sentence)) + 1), reverse=conditional)
    rules: list[Phrase] = []
    taken: set[int] = set()
    # `near people, no faster than 4 m/s`: the second clause alone would hold everywhere.
    for length, early in [(length, early) for early in (True, False) for length in lengths]:
        for first in range(len(sentence) - length + 1):
            last = first + length - 1
            if (
                taken & set(range(first, last + 1))
                or (rule := _rule(sentence, sentence.run(first, last), early=early)) is None
            ):
                continue
            while rule.has("WINDOW") and last + 1 < len(sentence):
                # `only from 20 to 90 s and from 150 to 280 s`: windows go on with `and`.
                longer = _rule(sentence, sentence.run(first, last + 1), early=early)
                if longer is None or not longer.has("WINDOW"):
                    break
                rule, last = longer, last + 1
            rules.append(rule)
            taken |= set(range(first, last + 1))
    others = [sentence.run(index) for index in range(len(sentence)) if index not in taken]
    if any(word.load is Load.CONDITION for run in others for word in run.loaded):
        # A condition that no rule holds may reach over the whole sentence.
        return [], set()
    return rules, taken


def _rule(sentence: SentenceRuns, run: Run, *, early: bool) -> Phrase | None:
    """The rule that a run is; None for any other run."""
    kinds = {meaning.kind for word in run.words for meaning in word.meanings}
    assets = {str(m.value) for word in run.words for m in word.meanings if m.kind == "ASSET"}
    roles = {sentence.vocabulary.role(asset) for asset in assets}
    persons = Role.BYSTANDER in roles or _PERSONS.search(run.plain) or _means_persons(sentence, run)
    about = "bystanders" if persons else "nobody"
    numbers = sorted(part.kind for part in run.quantities)
    excepted = run.plain != sentence.text[run.span.start : run.span.end]
    measured = replace(run, plain=blanked(_ABOVE_HOME, run.plain))
    for compiled in sentence.vocabulary.rules:
        rule = compiled.form
        assert isinstance(rule, RuleForm)
        if rule.early is not early:
            continue
        # A target is only spoken of where it may be marked.
        marking = "rules.no_mark_within_m" in rule.sets
        things = roles - {Role.BYSTANDER} - ({Role.ADVERSARY} if marking else set())
        speaks_of = rule.of == "anybody" or (rule.of == about and not things)
        fits = speaks_of and "DIR" not in kinds and rule.takes(numbers)
        if not fits or (excepted and not _HEIGHTS & set(rule.sets)):
            continue
        signs = measured.signs(compiled, sentence.context)
        led = rule.of == "bystanders" and not marking and not rule.early
        if signs is None or (led and _begins_with_them(sentence, run, signs)):
            continue
        if _is_accounted_for(run, rule, signs) and not _is_about_more(run, signs):
            return _phrase(sentence, run, rule, signs)
    return None


def _means_persons(sentence: SentenceRuns, run: Run) -> bool:
    """Whether a pronoun means bystanders: the last thing that was named before it, in this sentence or the one before."""
    if (pronoun := _PRONOUN.search(run.plain)) is None:
        return False
    at = run.span.start + pronoun.start()
    things = [
        (word.span.start, str(meaning.value))
        for word in sentence.earlier
        for meaning in word.meanings
        if meaning.kind == "ASSET" and word.span.start < at
    ]
    last = max(things, default=None)
    return (
        last is not None
        and sentence.vocabulary.role(last[1]) is Role.BYSTANDER
        and _NO_BYSTANDERS.search(sentence.text[max(0, last[0] - 20) : at]) is None
    )


def _phrase(sentence: SentenceRuns, run: Run, rule: RuleForm, signs: list[Span]) -> Phrase:
    """The rule with its numbers, and with what else of the run is read with it.

    Words that nobody knows are not among these, and so they are listed.
    """
    known = [
        word.span
        for word in run.words
        if word.filler or {meaning.kind for meaning in word.meanings} - {"HOME"}
    ]
    excepted = [
        Span(*match.span()) for match in EXCEPTION.finditer(sentence.text, run.span.start, run.span.end)
    ]
    people = [
        Span(match.start() + run.span.start, match.end() + run.span.start)
        for match in _PERSONS.finditer(run.plain)
    ]
    others = [*signs, *known, *people, *(word.span for word in run.loaded), *excepted]
    head = Part("WINDOW" if rule.window else "RULE", rule, signs[0])
    return Phrase("rule", (head, *run.quantities, *(Part("SIGN", None, span) for span in others)), run.span)


def _begins_with_them(sentence: SentenceRuns, run: Run, signs: list[Span]) -> bool:
    """Whether bystanders are the subject, as in `the children keep 10 m from each other`, which is no rule."""
    roles = sentence.vocabulary.role
    persons = [
        word.span.start
        for word in run.words
        for meaning in word.meanings
        if meaning.kind == "ASSET" and roles(str(meaning.value)) is Role.BYSTANDER
    ]
    return bool(persons) and min(persons) < min(sign.start for sign in signs)


def _is_about_more(run: Run, signs: list[Span]) -> bool:
    """Whether a word outside of the signs and numbers speaks of something that the rule is not about."""
    held = [*signs, *(part.span for part in run.quantities)]
    others = [word for word in run.words if not any(overlap(word.span, span) for span in held)]
    return any({meaning.kind for meaning in word.meanings} & FOREIGN_KINDS for word in others)


def _is_accounted_for(run: Run, rule: RuleForm, signs: list[Span]) -> bool:
    """Whether a rule holds every loaded word: in its signs and numbers, one denial, and the situation that it is for.

    The signs of a `loose` rule are its denials and conditions themselves.
    """
    held = [*signs, *(part.span for part in run.quantities)]
    others = [word for word in run.loaded if not any(overlap(word.span, span) for span in held)]
    others = [word for word in others if not _is_of_anybody(word, run)]
    if rule.of == "bystanders":
        # `when a person is within 50 m`: what a distance to people is for.
        others = [word for word in others if not _is_a_situation(word, run) and word.text.lower() != "one"]
    if rule.loose:
        # `any hostile is reported before ...`: an escort is warned of everybody.
        loads = {Load.NEGATION, Load.CONDITION} | ({Load.QUANTIFIER} if rule.of == "anybody" else set())
        return {word.load for word in others} <= loads
    denials = [word for word in run.loaded if word.load is Load.NEGATION]
    conditions = [word for word in run.loaded if word.load is Load.CONDITION]
    return not others and len(denials) <= 1 and len(conditions) <= 1 and not _UNREAD.search(run.plain)


def _is_a_situation(word: LoadedWord, run: Run) -> bool:
    """Whether a condition describes people, and not what is forbidden itself."""
    clause = run.plain[word.span.start - run.span.start :].split(",")[0]
    return (
        word.load is Load.CONDITION
        and _FORBIDS.search(clause) is None
        and _HAPPENS.search(clause) is not None
    )


def _is_of_anybody(word: LoadedWord, run: Run) -> bool:
    """Whether a quantifier only says of whom: `any bystander`, `every report`, `at all times`."""
    following = next(
        (item for item in run.words if item.span.start > word.span.start and not item.filler), None
    )
    inside = next((item for item in run.words if overlap(item.span, word.span)), None)
    kinds = {meaning.kind for meaning in following.meanings} if following is not None else set()
    in_phrase = inside is not None and inside.filler and " " in inside.text
    of_anybody = word.load is Load.QUANTIFIER and word.text.lower() in _ANYBODY
    return of_anybody and (in_phrase or bool(kinds & {"ASSET", "TARGET", "INTEL"}))

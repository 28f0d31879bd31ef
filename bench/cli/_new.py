"""A situation asked for step by step: every answer becomes a sentence of the controlled language."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.instance_analysis import BaseSimSpec, ClauseReading, Vocabulary

Prompt = Callable[[str], str]


@dataclass(frozen=True, slots=True)
class Step:
    """A question, and the sentence that an answer to it makes; skipped where the text has set `path`."""

    path: str
    question: str
    sentence: str
    none: str = ""
    """The sentence for the answer `none`."""


GROUND = Step("world.area", "Area in metres, as 600 by 250", "The area is {} m.")
CONDITIONS = (
    Step("environment.rain_level", "Rain: none, light, moderate or heavy", "{} rain.", "No rain."),
    Step("environment.fog_level", "Fog: none, light, moderate or heavy", "{} fog.", "No fog."),
    Step("environment.wind.speed_mps", "Wind, as 5 m/s from the west, or none", "Wind {}.", "No wind."),
    Step("environment.start_utc", "Start, as 14:30 UTC on 3 March 2026", "Start at {}."),
    Step("mission.altitude_m", "Height of the flight in metres", "Fly at {} m."),
    Step("mission.speed_mps", "Speed of the flight in m/s", "Fly at {} m/s."),
    Step("mission.time_limit_s", "Time limit in minutes", "Time limit {} minutes."),
    Step(
        "rules.no_mark_within_m",
        "Mark nothing within how many metres of bystanders",
        "Do not mark within {} m of civilians.",
    ),
    Step("rules.bystander_standoff_m", "Metres to keep from people", "Keep at least {} m away from people."),
)
THINGS = "What is there? One sentence, as: A radar vehicle at (120, -40)"
MORE = "Anything else? One sentence of the controlled language (`rebar prose --page`)"


class Interview:
    """The text so far and what it is read as. Only sentences that are read in full become part of it."""

    def __init__(
        self, text: str, vocabulary: Vocabulary, prompt: Prompt, show: Callable[[str], None]
    ) -> None:
        self._vocabulary, self._prompt, self._show = vocabulary, prompt, show
        self._answers: list[int] = []
        self._checked = False
        self.text = text
        self.result: BaseSimSpec | None = self._read(text) if text else None

    def _read(self, text: str) -> BaseSimSpec:
        from bench.instance_analysis import read_prose

        result = read_prose(text, self._vocabulary, self._answers)
        return result.model_copy(update={"checked": self._checked})

    def run(self) -> None:
        """Ask what is open in the text, then every question."""
        self.decide()
        self.check()
        self._show("Press Enter to leave a question at its default.")
        self.ask(GROUND)
        self.ask_sentences(THINGS)
        for step in CONDITIONS:
            self.ask(step)
        self.ask_sentences(MORE)

    def decide(self) -> None:
        """Ask for every open choice of the text; an empty answer takes the first reading."""
        while self.result is not None and self.result.open_choices:
            choice = self.result.open_choices[0]
            self._show(f"{choice.quote!r}: {choice.ask}")
            for number, reading in enumerate(choice.readings, start=1):
                self._show(f"  {number}. {reading}")
            answer = self._prompt("Which one? [1]") or "1"
            if answer.isdigit() and 1 <= int(answer) <= len(choice.readings):
                self._answers.append(int(answer))
                self.result = self._read(self.text)
            else:
                self._show(f"Answer with a number from 1 to {len(choice.readings)}.")

    def check(self) -> None:
        """Show what each clause was read as that is none of the controlled language; what is denied is left out."""
        while self.result is not None:
            denied = next(
                (clause for clause in self.result.unchecked if not self._is_right(self.result, clause)), None
            )
            if denied is None:
                break
            after = self.text[denied.end :].lstrip(" .,;:")
            self.text = f"{self.text[: denied.start].rstrip()} {after}".strip()
            # The answers were given to the choices of another text.
            self._answers = []
            self.result = self._read(self.text) if any(map(str.isalnum, self.text)) else None
            self.decide()
        self._checked = True
        if self.result is not None:
            self.result = self._read(self.text)

    def _is_right(self, result: BaseSimSpec, clause: ClauseReading) -> bool:
        from ._clause_view import field_summary

        summary = field_summary(clause, {receipt.path: receipt.value for receipt in result.receipts})
        self._show(f"{clause.quote!r} is read as: {summary or 'what was there before'}")
        return not self._prompt("Is that what it means? [yes] or no").lower().startswith("n")

    def ask(self, step: Step) -> None:
        """Ask one question until its answer is read, or is empty, which leaves the SimSpec's default."""
        while not self._is_set(step.path):
            answer = self._prompt(f"{step.question} [default]")
            if not answer:
                return
            if self._add(
                step.none if answer.lower() == "none" and step.none else step.sentence.format(answer)
            ):
                return

    def ask_sentences(self, question: str) -> None:
        """Ask for sentences until an empty one."""
        while answer := self._prompt(f"{question} [no more]"):
            self._add(answer if answer.endswith(".") else f"{answer}.")

    def _is_set(self, path: str) -> bool:
        stated = () if self.result is None else self.result.receipts
        return any(receipt.source != "default" and receipt.path.startswith(path) for receipt in stated)

    def _add(self, sentence: str) -> bool:
        """Add a sentence, if it is read in full and changes nothing that was settled."""
        sentence = sentence[0].upper() + sentence[1:]
        text = f"{self.text} {sentence}".strip()
        result = self._read(text)
        begin = len(text) - len(sentence)
        unread = [
            f"{passage.quote!r}: {passage.why}" for passage in result.not_understood if passage.end > begin
        ]
        unread += [f"{choice.quote!r}: {choice.ask}" for choice in result.open_choices if choice.end > begin]
        for reason in unread:
            self._show(f"  not read: {reason}")
        # What was there before is checked; what is added is compared at once.
        free = [clause for clause in result.clauses if clause.status == "check" and clause.end > begin]
        if unread or not all(self._is_right(result, clause) for clause in free):
            return False
        self.text, self.result = text, result
        return True


def new(
    out: Annotated[Path, typer.Option(help="File to write the SimSpec to")] = Path("situation.yaml"),
    from_prose: Annotated[
        str | None, typer.Option(help="A description to begin with; its choices are asked")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="SVG file to draw the situation to")] = None,
    vocabulary: Annotated[Path | None, typer.Option(help="Vocabulary file of your own")] = None,
) -> None:
    """Ask for a situation step by step, write its SimSpec, and draw it.

    Example: rebar new --from-prose "A radar vehicle, five civilians near it" --out scene.yaml --picture scene.svg
    """
    from bench.errors import SetupError
    from bench.instance_analysis import annotated_yaml, load_vocabulary

    from ._clause_view import clause_lines

    if os.path.lexists(out):
        raise SetupError(out, "exists already", "give another name with --out")
    # Before the questions: no answer is lost to a path that cannot be.
    out.parent.mkdir(parents=True, exist_ok=True)
    interview = Interview(from_prose or "", load_vocabulary(vocabulary), _prompt, print)
    if interview.result is not None:
        print("\n".join(clause_lines(interview.result, shutil.get_terminal_size().columns)))
    try:
        interview.run()
    except typer.Abort:
        print(f"\nNothing is written. To go on, give --from-prose what was said: {interview.text}")
        raise
    if interview.result is None:
        raise SetupError("rebar new", "nothing was described", "answer one question at least")
    out.write_text(annotated_yaml(interview.result), encoding="utf-8")
    _draw(interview.result, picture)
    print(f"wrote {out}{f' and {picture}' if picture else ''}. The same in words: {interview.text}")


def _prompt(question: str) -> str:
    return str(typer.prompt(question, default="", show_default=False)).strip()


def _draw(result: BaseSimSpec, picture: Path | None) -> None:
    from bench.realization import PlacementInfeasible, place

    from ._situation_map import situation_map, situation_svg, situation_text

    try:
        drawing = situation_map(place(result.simspec))
    except PlacementInfeasible as error:
        # The SimSpec is written all the same: one of its distances is what has to change.
        print(f"no scene of it was found: {error}")
        drawing = situation_map(result.simspec)
    print("\n".join(situation_text(drawing)))
    if picture is not None:
        picture.write_text(situation_svg(drawing), encoding="utf-8")

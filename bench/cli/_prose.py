"""Commands from words: prose to a base SimSpec, and a wanted tension to ranges of the key factors."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from bench.errors import Fault
    from bench.instance_analysis import BaseSimSpec, ProposedResult, VariedField
    from bench.simspec import SimSpec
    from decompositions import Decomposition

KEY_VARIABLE = "REBAR_LLM_KEY"
MOST_VARIATIONS = 256


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(prose)
    app.command()(tension)


def prose(
    text: Annotated[str | None, typer.Argument(help="The description; or --file")] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="A file with the description")] = None,
    explain: Annotated[bool, typer.Option(help="Where every field comes from: the words, or a default")] = False,
    accept: Annotated[
        list[int] | None, typer.Option(help="Reading to take of the next open question, from 1; again for more")
    ] = None,
    vocabulary: Annotated[Path | None, typer.Option(help="A vocabulary of your own, before the bench's")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="All of it for a machine: SimSpec, ranges, receipts, questions")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Write the base SimSpec there")] = None,
    campaign: Annotated[Path | None, typer.Option(help="Write a campaign there that varies the ranges")] = None,
    points: Annotated[int, typer.Option(min=1, max=10_000, help="Design points of that campaign")] = 17,
    groups: Annotated[bool, typer.Option(help="Group the variations by difficulty configuration")] = False,
    decomposition: Annotated[str, typer.Option(help="For --campaign and --groups: name or file of a decomposition")] = (
        "search-and-report"
    ),
    llm: Annotated[
        str | None, typer.Option(help="Model that proposes what grammar and vocabulary do not find: provider:name, or a name")
    ] = None,
    llm_url: Annotated[
        str | None,
        typer.Option(help=f"OpenAI-compatible server that has the model, else one at port 11434; its key from {KEY_VARIABLE}"),
    ] = None,
) -> None:
    """Turn a description into a base SimSpec with ranges, with a receipt for every field.

    Example: rebar prose "A radar vehicle, between 5 and 10 civilians within 50 m of it, heavy rain, at 80 m" --explain

    Example: rebar prose -f scene.txt --out scene.yaml --campaign campaign.yaml
    """
    from bench.documents import dump_value
    from bench.instance_analysis import ModelEndpoint, annotated_yaml, load_vocabulary, propose, read_prose

    given = _text(text, file)
    words = load_vocabulary(vocabulary)
    proposed: ProposedResult | None = None
    if llm is None:
        found = read_prose(given, words, accept or [])
    else:
        endpoint = ModelEndpoint(llm, llm_url, os.environ.get(KEY_VARIABLE))
        proposed = propose(given, words, endpoint, answers=accept or [])
        found = proposed.result
    if as_json:
        shown = found if proposed is None else proposed
        print(json.dumps(shown.model_dump(mode="json"), indent=2))
    else:
        for line in _remarks(found, proposed):
            print(line, file=sys.stderr)
    if found.simspec is None:
        raise typer.Exit(1)
    if explain and not as_json:
        print("\n".join(_explained(found)))
    if out is not None:
        out.write_text(annotated_yaml(found), encoding="utf-8")
    if campaign is not None:
        campaign.write_text(dump_value(_campaign(found, found.simspec, points, decomposition)), encoding="utf-8")
        for fault in _unrated(found.simspec, decomposition):
            print(f"not to be scored yet: {fault}", file=sys.stderr)
    if groups:
        print("\n".join(_grouped(found, found.simspec, decomposition)))
    if not (as_json or explain or groups or out or campaign):
        print(annotated_yaml(found), end="")


def _text(text: str | None, file: Path | None) -> str:
    from bench.documents import read_text
    from bench.errors import Fault, SetupError
    from bench.instance_analysis import MAX_CHARACTERS

    if (text is None) == (file is None):
        raise SetupError(Fault("prose", "give either the description or --file", "rebar prose 'a radar vehicle and 5 civilians'"))
    return text if text is not None else read_text(file or Path(), most_bytes=4 * MAX_CHARACTERS)


def _remarks(found: BaseSimSpec, proposed: ProposedResult | None) -> Iterator[str]:
    for word, other in found.corrected.items():
        yield f"{word!r} was read as {other!r}"
    for one in found.remarks:
        yield f"{one.quote!r}: {one.why}"
    for number, question in enumerate(found.questions, start=1):
        yield f"question {number}: {question.quote!r}: {question.ask}"
        yield from (f"  {index}. {reading}" for index, reading in enumerate(question.readings, start=1))
    if found.questions:
        yield "take a reading of each with --accept K, in this order"
    for varied in found.ranges:
        yield f"varies: {_span(varied)}"
    for one in found.not_expressible:
        yield f"not expressible: {one.quote!r}: {one.why}"
    for one in found.not_understood:
        yield f"not understood: {one.quote!r}: {one.why}"
    if proposed is not None:
        yield f"{proposed.model} was asked {proposed.rounds} times and decided {', '.join(proposed.decided_by_model) or 'nothing'}"
        yield from (f"refused of {proposed.model}: {one.quote}: {one.why}" for one in proposed.refused)


def _span(varied: VariedField) -> str:
    unit = f" {varied.unit}" if varied.unit else ""
    if varied.choices:
        return " or ".join(varied.choices)
    values = " or ".join(map(str, varied.levels)) if varied.levels else f"{varied.low:g} to {varied.high:g}"
    return f"{', '.join(varied.paths)}: {values}{unit}"


def _explained(found: BaseSimSpec) -> Iterator[str]:
    for one in found.receipts:
        if one.path == "description":
            continue
        note = f" ({one.note})" if one.note else ""
        source = f"{one.quote!r} {one.start}-{one.end}" if one.start is not None else ""
        word = one.source if one.source != "prose" else ""
        yield f"{one.path} = {json.dumps(one.value)} <- {' '.join(filter(None, (word, source)))}{note}"


def _factors(ranges: Sequence[VariedField]) -> list[dict[str, Any]]:
    factors: list[dict[str, Any]] = []
    for varied in ranges:
        taken = {one["name"] for one in factors}
        name = varied.name if varied.name not in taken else f"{varied.name}-{len(factors)}"
        factor: dict[str, Any] = {"name": name}
        if varied.unit and not varied.choices:
            factor["unit"] = varied.unit
        if varied.choices:
            factor |= {"levels": list(varied.choices), "patches": varied.choices}
        elif varied.levels:
            factor |= {"levels": list(varied.levels), "sets": list(varied.paths)}
        else:
            clean = int if varied.integer else float
            ends = {"low": clean(varied.low or 0.0), "high": clean(varied.high or 0.0), "integer": varied.integer}
            factor |= {"range": ends, "sets": list(varied.paths)}
        factors.append(factor)
    return factors


def _unrated(simspec: SimSpec, decomposition: str) -> Sequence[Fault]:
    """What the description would have to speak of for the campaign to be rated, and so flown."""
    from bench.errors import SetupError
    from bench.scoring import difficulty_of

    asked = _decomposition(decomposition)
    try:
        difficulty_of(asked, simspec)
    except SetupError as error:
        return error.faults
    return ()


def _campaign(found: BaseSimSpec, simspec: SimSpec, points: int, decomposition: str) -> dict[str, Any]:
    """Plain values of a campaign over the ranges: a Latin hypercube, or every combination where there are levels alone."""
    from bench.campaign import Campaign
    from bench.documents import validate_document
    from bench.instance_analysis import stated_values

    factors = _factors(found.ranges)
    ranged = any("range" in one for one in factors)
    method = {"kind": "latin_hypercube", "points": points} if ranged else {"kind": "full_factorial"}
    written = {
        "format": "rebar.campaign/1",
        "name": "prose",
        "base": stated_values(found),
        "agents": [{"manifest": simspec.agent.manifest}],
        "decomposition": decomposition,
        "design": {"factors": factors, "method": method},
    }
    validate_document(written, Campaign, source="campaign")
    return written


def _variations(found: BaseSimSpec, simspec: SimSpec) -> Iterator[tuple[str, SimSpec]]:
    """The ends of every range and every level, combined, as far as they are not too many."""
    from bench.documents import validate_document
    from bench.realization import Design, situations

    if not found.ranges:
        yield "as it is", simspec
        return
    factors = _factors(found.ranges)
    for factor in factors:
        if ends := factor.pop("range", None):
            clean = int if ends["integer"] else float
            factor["levels"] = [clean(ends["low"]), clean(ends["high"])]
    design = validate_document({"factors": factors}, Design, source="ranges")
    points = design.pairs()[:MOST_VARIATIONS]
    for (point, _), varied in zip(points, situations(simspec, design, [point for point, _ in points]), strict=True):
        yield ", ".join(f"{name} {level}" for name, level in point.levels.items()), varied


def _grouped(found: BaseSimSpec, simspec: SimSpec, name: str) -> Iterator[str]:
    from bench.scoring import configuration_of, configuration_tension, difficulty_of

    asked = _decomposition(name)
    configurations: dict[str, list[str]] = {}
    tensions: dict[str, int] = {}
    for named, varied in _variations(found, simspec):
        rated = difficulty_of(asked, varied)
        key = configuration_of(asked, rated)
        configurations.setdefault(key, []).append(named)
        tensions[key] = configuration_tension(asked, rated)
    for key, members in configurations.items():
        yield f"{key} (tension {tensions[key]}): {len(members)} variations"
        yield from (f"  {one}" for one in members)


def _decomposition(name: str) -> Decomposition:
    from bench.simspec import FACTORS
    from decompositions import DecompositionVocabulary, load_decomposition

    return load_decomposition(name, DecompositionVocabulary({one: factor.unit for one, factor in FACTORS.items()}))


def tension(
    node: Annotated[str, typer.Argument(help="Node of the decomposition, or words of a key attribute's title")],
    wanted: Annotated[int, typer.Argument(min=1, max=5, help="Tension, 1 to 5")],
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    as_json: Annotated[bool, typer.Option("--json", help="For a machine to read")] = False,
) -> None:
    """Which ranges of the key factors give a node a tension.

    Example: rebar tension KA-03 4

    Example: rebar tension "bystander classification" 4
    """
    asked = _decomposition(decomposition)
    node = _node(asked, node)
    rows = list(_bounds(asked, node, wanted))
    if as_json:
        print(json.dumps({"node": node, "tension": wanted, "factors": rows}, indent=2))
        return
    lowest, highest = 20 * (wanted - 1), 20 * wanted
    print(f"{node} {asked.nodes[node].title} has tension {wanted} where its difficulty is above {lowest} and at most {highest}:")
    print("every factor at least as hard as its first value, and one of them no harder than its second.")
    for row in rows:
        print(f"  {row['factor']} [{row['unit']}]: {_told(row['from'], row['from_past'])} to {_told(row['to'], False)}")
    unreached = [str(row["factor"]) for row in rows if row["from"] is None]
    if unreached:
        print(f"No situation has it: the tables of {', '.join(unreached)} end before.")
        raise typer.Exit(1)


def _node(asked: Decomposition, words: str) -> str:
    """The node of that id, or the one key attribute whose title has all of these words."""
    from bench.errors import Fault, SetupError
    from decompositions import Level

    from ._scores import known_node

    if words in asked.nodes or " " not in words.strip():
        known_node("NODE", asked, words)
        return words
    sought = [word.lower() for word in words.split()]
    attributes = asked.at_level(Level.KEY_ATTRIBUTE)
    found = [one for one in attributes if all(word in asked.nodes[one].title.lower() for word in sought)]
    if len(found) != 1:
        fitting = ", ".join(f"{one} {asked.nodes[one].title}" for one in found) or "none"
        raise SetupError(
            Fault("NODE", f"{len(found)} key attributes have {words!r} in their title", f"name one; fitting: {fitting}")
        )
    return found[0]


def _told(value: float | None, past: bool) -> str:
    return "the table's end" if value is None else f"{'beyond ' if past else ''}{value:.6g}"


def _bounds(asked: Decomposition, node: str, wanted: int) -> Iterator[dict[str, Any]]:
    """For each key factor: the value from which no table of it rates too low, and the one up to which some table does not
    rate too high; None where a table ends before."""
    from bench.scoring import value_for_rating

    tables: dict[str, list[Any]] = {}
    for leaf in asked.observables_under(node):
        for row in asked.key_factors(leaf):
            tables.setdefault(row.factor, []).append(row)
    for factor, rows in tables.items():
        rising = rows[0].values[-1] > rows[0].values[0]
        sign = 1.0 if rising else -1.0
        if wanted == 1:
            lows: list[tuple[float, bool] | None] = [(row.values[0], False) for row in rows]
        else:
            lows = [value_for_rating(row, 20.0 * (wanted - 1), asked.policies, exceeded=True) for row in rows]
        highs = [value_for_rating(row, 20.0 * wanted, asked.policies) for row in rows]
        low = None if None in lows else max((one for one in lows if one), key=lambda one: sign * one[0])
        high = None if None in highs else max((one[0] for one in highs if one), key=lambda one: sign * one)
        low_value, past = low if low else (None, False)
        yield {"factor": factor, "unit": rows[0].unit, "from": low_value, "from_past": past, "to": high}

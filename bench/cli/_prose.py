"""Commands that start from words: prose to a base SimSpec, and a tension to ranges of the key factors."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._tables import plain_console, print_lines

if TYPE_CHECKING:
    from bench.errors import Fault
    from bench.instance_analysis import BaseSimSpec, Rewrite, RewrittenResult, VariedField, Vocabulary
    from bench.simspec import SimSpec
    from decompositions import Decomposition

# From the environment, not by an option: command lines are visible to other users of the machine.
KEY_VARIABLE = "REBAR_LLM_KEY"
MAX_PATH_CHARACTERS = 255
"""From here on, file systems refuse a name, and a text is no path."""
NAME_WORDS, NAME_CHARACTERS = 5, 40
"""Words and characters of a text that name its campaign."""
MAX_VARIATIONS = 256
"""Variations that --groups rates at most, so that an answer takes seconds. Chosen, not measured."""


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command()(prose)
    app.command()(tension)


def prose(
    text: Annotated[str | None, typer.Argument(help="The description, or use --file")] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="File with the description")] = None,
    explain: Annotated[
        bool, typer.Option(help="Show where every field comes from: the words, or a default")
    ] = False,
    accept: Annotated[
        list[int] | None,
        typer.Option(help="Number of the reading that answers the next choice, from 1. Repeatable"),
    ] = None,
    vocabulary: Annotated[
        Path | None, typer.Option(help="Vocabulary file of your own, which takes precedence")
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 1, and write nothing, unless all is certain")
    ] = False,
    checked: Annotated[
        bool,
        typer.Option(
            "--checked", help="You have compared the values of all `check` clauses with their words"
        ),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: SimSpec, ranges, receipts, clauses and choices")
    ] = False,
    html: Annotated[
        Path | None, typer.Option(help="File to write the text, clause by clause, as a page")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="File to write the base SimSpec to")] = None,
    campaign: Annotated[
        Path | None, typer.Option(help="File to write a campaign to that varies the ranges")
    ] = None,
    points: Annotated[int, typer.Option(min=1, max=10_000, help="Design points of that campaign")] = 17,
    groups: Annotated[bool, typer.Option(help="Group the variations by difficulty configuration")] = False,
    decomposition: Annotated[
        str, typer.Option(help="For --campaign and --groups: name or file of a decomposition")
    ] = ("search-and-report"),
    agent: Annotated[
        list[str] | None, typer.Option(help="For --campaign: manifest of an agent that flies. Repeatable")
    ] = None,
    llm: Annotated[
        str | None,
        typer.Option(
            help="Language model that rewrites the text into sentences of the controlled language: provider:name, or a name"
        ),
    ] = None,
    rewrite: Annotated[
        Path | None,
        typer.Option(help="Rewrite of the text that a model has written before; no model is asked"),
    ] = None,
    llm_url: Annotated[
        str | None,
        typer.Option(
            help=f"OpenAI-compatible server with the model. Default: port 11434. Its key is read from {KEY_VARIABLE}"
        ),
    ] = None,
) -> None:
    """Turn a description into a base SimSpec with ranges, and tell what became of every clause.

    A document is always written. What is uncertain is a choice, of which the first reading is taken; --accept
    takes another one. A clause marked `check` is read in full, but may be read wrongly: compare its values with it.
    With --llm and --out, the rewrite is written beside the SimSpec, and --rewrite reads it again without a model.

    Example: rebar prose "A radar vehicle, between 5 and 10 civilians within 50 m of it, heavy rain, fly at 80 m"
    --explain

    Example: rebar prose -f scene.txt --out scene.yaml --campaign campaign.yaml
    """
    from bench.documents import dump_value
    from bench.instance_analysis import annotated_yaml, load_vocabulary, read_prose

    from ._clause_view import clause_lines, clause_page

    description = _description(text, file)
    words = load_vocabulary(vocabulary)
    rewritten: RewrittenResult | None = None
    if llm is None:
        stored = None if rewrite is None else _stored(rewrite)
        base_simspec = read_prose(description, words, accept or [], stored)
    else:
        rewritten = _rewritten(description, words, llm, llm_url, accept or [])
        base_simspec = rewritten.result
    base_simspec = base_simspec.model_copy(update={"checked": checked})
    if as_json:
        shown = base_simspec if rewritten is None else rewritten.model_copy(update={"result": base_simspec})
        print(json.dumps(shown.model_dump(mode="json"), indent=2))
    else:
        # On stderr: stdout belongs to the document, which may be piped into a file.
        width = shutil.get_terminal_size().columns
        for line in (*clause_lines(base_simspec, width), *_rewritten_lines(rewritten)):
            print(line, file=sys.stderr)
    if strict and not base_simspec.certain:
        raise typer.Exit(1)
    if explain and not as_json:
        print_lines(plain_console(), _explained(base_simspec))
    if html is not None:
        html.write_text(clause_page(base_simspec), encoding="utf-8")
    if out is not None:
        out.write_text(annotated_yaml(base_simspec), encoding="utf-8")
        if rewritten is not None and rewritten.rewrite.pairs:
            beside = out.with_suffix(".rewrite.yaml")
            plain = rewritten.rewrite.model_dump(mode="json", exclude_defaults=True)
            beside.write_text(dump_value({"format": rewritten.rewrite.format} | plain), encoding="utf-8")
    if campaign is not None:
        agents = [_from_folder(manifest, campaign.parent) for manifest in agent or []]
        campaign.write_text(
            dump_value(_campaign(base_simspec, points, decomposition, agents)), encoding="utf-8"
        )
        for fault in _unrated(base_simspec.simspec, decomposition):
            print(f"cannot be scored yet: {fault}", file=sys.stderr)
    if groups:
        print_lines(plain_console(), _grouped(base_simspec, base_simspec.simspec, decomposition))
    # A terminal shows the clauses on one screen; the document itself would scroll them away.
    if not (as_json or explain or groups or html or out or campaign or sys.stdout.isatty()):
        print(annotated_yaml(base_simspec), end="")


def _description(text: str | None, file: Path | None) -> str:
    from bench.documents import read_text
    from bench.errors import Fault, SetupError
    from bench.instance_analysis import MAX_CHARACTERS

    if (text is None) == (file is None):
        raise SetupError(
            Fault(
                "prose",
                "give either a description or --file",
                "for example rebar prose 'a radar vehicle and 5 civilians'",
            )
        )
    if text is not None and len(text) < MAX_PATH_CHARACTERS and Path(text).is_file():
        raise SetupError(
            Fault("prose", f"{text} is a file, and no description", f"read it with --file {text}")
        )
    # UTF-8 takes up to four bytes for a character.
    return text if text is not None else read_text(file or Path(), max_bytes=4 * MAX_CHARACTERS)


def _stored(path: Path) -> Rewrite:
    from bench.documents import load_document
    from bench.instance_analysis import Rewrite

    return load_document(path, Rewrite)


def _rewritten(
    description: str, words: Vocabulary, model: str, url: str | None, answers: Sequence[int]
) -> RewrittenResult:
    from bench.instance_analysis import ModelEndpoint, rewrite_prose

    endpoint = ModelEndpoint(model, url, os.environ.get(KEY_VARIABLE))
    return rewrite_prose(description, words, endpoint, answers=answers)


def _rewritten_lines(rewritten: RewrittenResult | None) -> Iterator[str]:
    """How often the model was asked, what of its answer does not hold, and why there is none."""
    if rewritten is None:
        return
    if rewritten.failure:
        yield f"{rewritten.model} gave no whole rewrite, and the document stands without it: {rewritten.failure}"
    yield f"{rewritten.model} was asked {rewritten.rounds} times and wrote {len(rewritten.rewrite.pairs)} sentences"
    yield from (
        f"refused from {rewritten.model}: {refusal.quote}: {refusal.why}" for refusal in rewritten.refused
    )


def _explained(base_simspec: BaseSimSpec) -> Iterator[str]:
    for receipt in base_simspec.receipts:
        if receipt.path == "description":
            continue
        note = f" ({receipt.note})" if receipt.note else ""
        source = f"{receipt.quote!r} {receipt.start}-{receipt.end}" if receipt.start is not None else ""
        word = receipt.source if receipt.source != "prose" else ""
        yield f"{receipt.path} = {json.dumps(receipt.value)} <- {' '.join(filter(None, (word, source)))}{note}"


def _factors(ranges: Sequence[VariedField]) -> list[dict[str, Any]]:
    factors: list[dict[str, Any]] = []
    for varied in ranges:
        names = {factor["name"] for factor in factors}
        # Two phrases may vary fields of the same name, and factors of a design have distinct names.
        name = varied.name if varied.name not in names else f"{varied.name}-{len(factors)}"
        factor: dict[str, Any] = {"name": name}
        if varied.unit and not varied.choices:
            factor["unit"] = varied.unit
        if varied.choices:
            factor |= {"levels": list(varied.choices), "patches": varied.choices}
        elif varied.levels:
            factor |= {"levels": list(varied.levels), "sets": list(varied.paths)}
        else:
            clean = int if varied.integer else float
            ends = {
                "low": clean(varied.low or 0.0),
                "high": clean(varied.high or 0.0),
                "integer": varied.integer,
            }
            factor |= {"range": ends, "sets": list(varied.paths)}
        factors.append(factor)
    return factors


def _unrated(simspec: SimSpec, decomposition: str) -> Sequence[Fault]:
    """What the description has to mention before the decomposition can rate the campaign, and so fly it."""
    from bench.errors import SetupError
    from bench.scoring import difficulty_of

    try:
        difficulty_of(_decomposition(decomposition), simspec)
    except SetupError as error:
        return error.faults
    return ()


def _campaign(
    base_simspec: BaseSimSpec, points: int, decomposition: str, agents: Sequence[str]
) -> dict[str, Any]:
    """A campaign over the ranges as plain values: a Latin hypercube, or every combination if there are only
    levels. It carries the text, and what was open when it was written.
    """
    from bench.campaign import Campaign
    from bench.documents import validate_document
    from bench.instance_analysis import stated_values

    factors = _factors(base_simspec.ranges)
    ranged = any("range" in factor for factor in factors)
    # A range has no levels to combine, so the points are spread over it instead.
    method = {"kind": "latin_hypercube", "points": points} if ranged else {"kind": "full_factorial"}
    document = {
        "format": "rebar.campaign/1",
        "name": _campaign_name(base_simspec.prose),
        "description": _campaign_description(base_simspec),
        "base": stated_values(base_simspec),
        "agents": [{"manifest": manifest} for manifest in agents or [base_simspec.simspec.agent.manifest]],
        "decomposition": decomposition,
        "design": {"factors": factors, "method": method},
    }
    validate_document(document, Campaign, source="campaign")
    return document


def _from_folder(manifest: str, folder: Path) -> str:
    """The manifest as a campaign in a folder names it: the path of a file from there, or an entry point."""
    from bench.simspec import is_manifest_file

    return os.path.relpath(manifest, folder) if is_manifest_file(manifest) else manifest


def _campaign_name(text: str) -> str:
    """A name made of the first words of a text."""
    words = re.findall(r"[a-z0-9]+", text.lower())[:NAME_WORDS]
    name = "-".join(words)[:NAME_CHARACTERS].strip("-")
    return name if name[:1].isalpha() else f"prose-{name}".strip("-")


def _campaign_description(base_simspec: BaseSimSpec) -> str:
    """The text, and under it the choices that nobody has answered."""
    choices = [
        f"Open: {choice.quote!r}: {choice.ask} Read as: {choice.readings[choice.chosen - 1]}"
        for choice in base_simspec.open_choices
    ]
    unread = [f"Not read: {item.quote!r}" for item in base_simspec.not_understood]
    return "\n".join([base_simspec.prose.strip(), *choices, *unread])


def _variations(base_simspec: BaseSimSpec, simspec: SimSpec) -> Iterator[tuple[str, SimSpec]]:
    """Combinations of the ends of every range and of every level, up to MAX_VARIATIONS."""
    from bench.documents import validate_document
    from bench.realization import Design, situations

    if not base_simspec.ranges:
        yield "unchanged", simspec
        return
    factors = _factors(base_simspec.ranges)
    for factor in factors:
        if ends := factor.pop("range", None):
            clean = int if ends["integer"] else float
            factor["levels"] = [clean(ends["low"]), clean(ends["high"])]
    design = validate_document({"factors": factors}, Design, source="ranges")
    points = design.pairs()[:MAX_VARIATIONS]
    for (point, _), varied in zip(
        points, situations(simspec, design, [point for point, _ in points]), strict=True
    ):
        yield ", ".join(f"{name} {level}" for name, level in point.levels.items()), varied


def _grouped(base_simspec: BaseSimSpec, simspec: SimSpec, name: str) -> Iterator[str]:
    from bench.scoring import configuration_of, configuration_tension, difficulty_of

    tree = _decomposition(name)
    configurations: dict[str, list[str]] = {}
    tensions: dict[str, int | None] = {}
    for variation, varied in _variations(base_simspec, simspec):
        rated = difficulty_of(tree, varied)
        key = configuration_of(tree, rated)
        configurations.setdefault(key, []).append(variation)
        tensions[key] = configuration_tension(tree, rated)
    for key, members in configurations.items():
        yield f"{key} (tension {tensions[key] or 'none'}): {len(members)} variations"
        yield from (f"  {variation}" for variation in members)


def _decomposition(name_or_path: str) -> Decomposition:
    from bench.simspec import FACTORS
    from decompositions import DecompositionVocabulary, load_decomposition

    return load_decomposition(
        name_or_path, DecompositionVocabulary({name: factor.unit for name, factor in FACTORS.items()})
    )


def tension(
    node: Annotated[
        str, typer.Argument(help="Node of the decomposition, or words from the title of a key attribute")
    ],
    wanted: Annotated[int, typer.Argument(min=1, max=5, help="Tension, 1 to 5")],
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Show the ranges of the key factors that give a node a tension.

    Example: rebar tension KA-03 4

    Example: rebar tension "bystander classification" 4
    """
    from bench.errors import Fault, SetupError

    tree = _decomposition(decomposition)
    node = _node(tree, node)
    if tree.policies.factor_rule != "minimum":
        raise SetupError(
            Fault(
                tree.name,
                "the policy factor_rule: mean lets no range of a single factor decide",
                "rate a SimSpec with: rebar difficulty",
            )
        )
    rows = list(_factor_ranges(tree, node, wanted))
    if as_json:
        print(json.dumps({"node": node, "tension": wanted, "factors": rows}, indent=2))
        return
    # Tension n covers difficulties above 20 (n - 1) up to 20 n.
    above = f"above {20 * (wanted - 1)} and " if wanted > 1 else ""
    lines = [
        f"{node} {tree.nodes[node].title} has tension {wanted} where its difficulty is {above}at most {20 * wanted}:",
        "every factor is at least as hard as its first value, and one that has a second is no harder than that.",
        *(f"  {row['factor']} [{row['unit']}]: {_range_text(row, wanted)}" for row in rows),
    ]
    console = plain_console()
    print_lines(console, lines)
    unreached = [str(row["factor"]) for row in rows if row["from"] is None]
    if unreached or not any(row["decides"] for row in rows):
        reason = (
            f"the tables of {', '.join(unreached)} end before it" if unreached else "no factor rates so low"
        )
        print_lines(console, [f"No situation within the tables has this tension: {reason}."])
        raise typer.Exit(1)


def _node(tree: Decomposition, words: str) -> str:
    """The node with that id, or the only key attribute whose title has all of these words."""
    from bench.errors import Fault, SetupError
    from decompositions import Level

    from ._scores import check_node

    if words in tree.nodes or " " not in words.strip():
        check_node("NODE", tree, words)
        return words
    title_words = [word.lower() for word in words.split()]
    attributes = tree.at_level(Level.KEY_ATTRIBUTE)
    matches = [
        node for node in attributes if all(word in tree.nodes[node].title.lower() for word in title_words)
    ]
    if len(matches) != 1:
        choices = ", ".join(f"{node} {tree.nodes[node].title}" for node in matches) or "none"
        raise SetupError(
            Fault(
                "NODE",
                f"{len(matches)} key attributes have {words!r} in their title",
                f"name one; matches: {choices}",
            )
        )
    return matches[0]


def _range_text(row: dict[str, Any], wanted: int) -> str:
    if row["from"] is None:
        return "its table ends before"
    # Rounded into the range: what is printed, put into a SimSpec, must give the tension.
    harder, easier = (ROUND_CEILING, ROUND_FLOOR) if row["rises"] else (ROUND_FLOOR, ROUND_CEILING)
    begin = f"{'beyond ' if row['from_past'] else ''}{_rounded(row['from'], harder)}"
    if not row["decides"]:
        return f"{begin} or harder; no value rates at most {20 * wanted}"
    if row["to"] is None:
        return f"{begin} to the table's end"
    return f"{begin} to {'short of ' if row['to_before'] else ''}{_rounded(row['to'], easier)}"


def _rounded(value: float, rounding: str) -> str:
    # Twelve digits first: 0.2 is no more than 0.2.
    return f"{float(Context(prec=6, rounding=rounding).create_decimal(f'{value:.12g}')):.6g}"


def _factor_ranges(tree: Decomposition, node: str, wanted: int) -> Iterator[dict[str, Any]]:
    """For each key factor, the range in which the node has the tension.

    From the first value on, no table of the factor rates too low; it is None if one ends before. Up to the second, at
    least one does not rate too high, so that the factor decides; it is None for the table's end.
    """
    from bench.scoring import hardest_value, value_for_rating

    tables: dict[str, list[Any]] = {}
    for leaf in tree.observables_under(node):
        # In no SimSpec do those about the bench's detections count for another node than themselves (ruling 25).
        if leaf == node or tree.observables[leaf].subject != "perception":
            for row in tree.key_factors(leaf):
                tables.setdefault(row.factor, []).append(row)
    for factor, rows in tables.items():
        rises = rows[0].values[-1] > rows[0].values[0]
        sign = 1.0 if rises else -1.0
        # Tension 1 begins at the easy end of every table, so nothing has to be exceeded.
        lows = [
            value_for_rating(row, 20.0 * (wanted - 1), tree.policies, exceeded=True)
            if wanted > 1
            else (row.values[0], False)
            for row in rows
        ]
        low = max((low for low in lows if low), key=lambda low: (sign * low[0], low[1]), default=None)
        if low is None or None in lows:
            low = (None, False)
        highs = [high for row in rows if (high := hardest_value(row, 20.0 * wanted, tree.policies))]
        to, before = max(
            highs, key=lambda high: (sign * high[0], not high[1]), default=(-sign * math.inf, True)
        )
        is_past = bool(low[1])
        decides = low[0] is not None and (
            sign * low[0] < sign * to or (low[0] == to and not is_past and not before)
        )
        yield {
            "factor": factor,
            "unit": rows[0].unit,
            "rises": rises,
            "from": low[0],
            "from_past": is_past,
            "to": to if decides and math.isfinite(to) else None,
            "to_before": decides and before,
            "decides": decides,
        }

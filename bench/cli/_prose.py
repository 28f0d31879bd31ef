"""The command that turns words into a base SimSpec, and a campaign over its ranges."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._tables import print_lines

if TYPE_CHECKING:
    from bench.errors import Fault
    from bench.instance_analysis import BaseSimSpec, RewrittenResult, VariedField, Vocabulary
    from bench.simspec import SimSpec

# From the environment, not by an option: command lines are visible to other users of the machine.
KEY_VARIABLE = "REBAR_LLM_KEY"
MAX_PATH_CHARACTERS = 255
"""From here on, file systems refuse a name, and a text is no path."""
POINTS = 17
"""Design points of a campaign over ranges. Chosen: the file says it, and is edited."""
MAX_VARIATIONS = 256
"""Variations that --groups rates at most, so that an answer takes seconds. Chosen, not measured."""
NAME_WORDS, NAME_CHARACTERS = 5, 40
"""Words and characters of a text that name its campaign."""


def prose(
    text: Annotated[str | None, typer.Argument(help="The description, or use --file")] = None,
    file: Annotated[Path | None, typer.Option("--file", "-f", help="File with the description")] = None,
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
    page: Annotated[
        bool, typer.Option("--page", help="Print the whole page of the controlled language, and read nothing")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: SimSpec, ranges, receipts, clauses and choices")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="File to write the base SimSpec to")] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(
            help="File to write a campaign to that varies the ranges. With --groups: new folder, for a campaign of each group"
        ),
    ] = None,
    groups: Annotated[
        bool, typer.Option("--groups", help="Group the ends of all ranges by difficulty: equi-ethical groups")
    ] = False,
    measured: Annotated[
        bool,
        typer.Option(
            "--measured", help="For --groups: by measured difficulty, in place of published ratings"
        ),
    ] = False,
    decomposition: Annotated[
        str, typer.Option(help="For --campaign and --groups: name or file of a decomposition")
    ] = "search-and-report",
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

    Example: rebar prose -f scene.txt --out scene.yaml --campaign campaign.yaml

    Example: rebar prose -f scene.txt --groups --campaign groups
    """
    from bench.instance_analysis import annotated_yaml, load_vocabulary
    from bench.instance_analysis import page as language_page

    if page:
        print(language_page(), end="")
        return
    description, words = _description(text, file), load_vocabulary(vocabulary)
    result, rewritten = _read(description, words, accept or (), llm, llm_url, rewrite)
    result = result.model_copy(update={"checked": checked})
    _show(result, rewritten, as_json)
    if strict and not result.certain:
        raise typer.Exit(1)
    if out is not None:
        _write(result, rewritten, out)
    if groups:
        print_lines(*_grouped(result, decomposition, measured, campaign, agent or ()))
    elif campaign is not None:
        _write_campaign(campaign, result, decomposition, agent or ())
    # A terminal shows the clauses on one screen; the document itself would scroll them away.
    if not any((as_json, groups, out, campaign, sys.stdout.isatty())):
        print(annotated_yaml(result), end="")


def _show(result: BaseSimSpec, rewritten: RewrittenResult | None, as_json: bool) -> None:
    """Print the clauses, or the whole result as JSON."""
    from ._clause_view import clause_lines

    if as_json:
        shown = result if rewritten is None else rewritten.model_copy(update={"result": result})
        print(json.dumps(shown.model_dump(mode="json"), indent=2))
        return
    # On stderr: stdout belongs to the document, which may be piped into a file.
    width = shutil.get_terminal_size().columns
    for line in (*clause_lines(result, width), *_rewritten_lines(rewritten)):
        print(line, file=sys.stderr)


def _write(result: BaseSimSpec, rewritten: RewrittenResult | None, out: Path) -> None:
    """Write the SimSpec, and the rewrite beside it."""
    from bench.documents import dump_value
    from bench.instance_analysis import annotated_yaml

    out.write_text(annotated_yaml(result), encoding="utf-8")
    if rewritten is not None and rewritten.rewrite.pairs:
        values = rewritten.rewrite.model_dump(mode="json", exclude_defaults=True)
        text = dump_value({"format": rewritten.rewrite.format} | values)
        out.with_suffix(".rewrite.yaml").write_text(text, encoding="utf-8")


def _write_campaign(path: Path, result: BaseSimSpec, decomposition: str, agents: Sequence[str]) -> None:
    """Write the campaign, and print what the text lacks to be scored."""
    from bench.documents import dump_value

    unrated = _unrated(result.simspec, decomposition)
    manifests = [_from_folder(manifest, path.parent) for manifest in agents]
    document = _campaign(result, decomposition, manifests)
    path.write_text(dump_value(document), encoding="utf-8")
    for fault in unrated:
        print(f"cannot be scored yet: {fault}", file=sys.stderr)


def _description(text: str | None, file: Path | None) -> str:
    from bench.documents import read_text
    from bench.errors import SetupError
    from bench.instance_analysis import MAX_CHARACTERS

    if (text is None) == (file is None):
        what = "give either a description or --file"
        raise SetupError("prose", what, "for example rebar prose 'a radar vehicle and 5 civilians'")
    if text is not None and len(text) < MAX_PATH_CHARACTERS and Path(text).is_file():
        raise SetupError("prose", f"{text} is a file, and no description", f"read it with --file {text}")
    # UTF-8 takes up to four bytes for a character.
    return text if text is not None else read_text(file or Path(), max_bytes=4 * MAX_CHARACTERS)


def _read(
    description: str,
    words: Vocabulary,
    answers: Sequence[int],
    llm: str | None,
    llm_url: str | None,
    rewrite: Path | None,
) -> tuple[BaseSimSpec, RewrittenResult | None]:
    """The reading of a text, and what a model has made of it where one is asked."""
    from bench.documents import load_document
    from bench.errors import SetupError
    from bench.instance_analysis import ModelEndpoint, Rewrite, read_prose, rewrite_prose

    if llm is not None and rewrite is not None:
        raise SetupError("prose", "--llm asks a model and --rewrite asks none", "give one of them")
    if llm is None and llm_url is not None:
        raise SetupError("prose", "--llm-url is the server of a model", "name the model with --llm")
    if llm is None:
        stored = None if rewrite is None else load_document(rewrite, Rewrite)
        return read_prose(description, words, answers, stored), None
    endpoint = ModelEndpoint(llm, llm_url, os.environ.get(KEY_VARIABLE))
    rewritten = rewrite_prose(description, words, endpoint, answers=answers)
    return rewritten.result, rewritten


def _rewritten_lines(rewritten: RewrittenResult | None) -> Iterator[str]:
    """How often the model was asked, what of its answer does not hold, and why there is none."""
    if rewritten is None:
        return
    if rewritten.failure:
        yield f"{rewritten.model} gave no whole rewrite, and the document stands without it: {rewritten.failure}"
    yield f"{rewritten.model} was asked {rewritten.rounds} times and wrote {len(rewritten.rewrite.pairs)} sentences"
    yield from (
        f"refused from {rewritten.model}: {refusal.quote!r}: {refusal.why}" for refusal in rewritten.refused
    )


def _factors(ranges: Sequence[VariedField]) -> list[dict[str, Any]]:
    factors: list[dict[str, Any]] = []
    for varied in ranges:
        names = {factor["name"] for factor in factors}
        # Two phrases may vary fields of the same name, and factors of a design have distinct names.
        name = varied.name if varied.name not in names else f"{varied.name}-{len(factors)}"
        unit = {"unit": varied.unit} if varied.unit and not varied.choices else {}
        factors.append({"name": name, **unit, **_values(varied)})
    return factors


def _values(varied: VariedField) -> dict[str, Any]:
    """The levels or the range of a factor, and what it sets."""
    if varied.choices:
        return {"levels": list(varied.choices), "patches": varied.choices}
    if varied.levels:
        return {"levels": list(varied.levels), "sets": list(varied.paths)}
    clean = int if varied.integer else float
    ends = {"low": clean(varied.low or 0.0), "high": clean(varied.high or 0.0), "integer": varied.integer}
    return {"range": ends, "sets": list(varied.paths)}


def _group_campaign(
    base_simspec: BaseSimSpec, decomposition: str, agents: Sequence[str], varied: Sequence[SimSpec]
) -> dict[str, Any]:
    """A campaign over variations of one difficulty configuration, as situations `v1`, `v2`, ..."""
    from bench.campaign import Campaign
    from bench.documents import validate_document
    from bench.instance_analysis import stated_values

    document = _campaign(base_simspec, decomposition, agents)
    bases = [stated_values(base_simspec.model_copy(update={"simspec": simspec})) for simspec in varied]
    situations = [{"name": f"v{number}", "base": base} for number, base in enumerate(bases, start=1)]
    kept = {key: value for key, value in document.items() if key not in ("base", "design")}
    document = {**kept, "situations": situations, "design": {"replicates": 1}}
    validate_document(document, Campaign, source="campaign")
    return document


def _unrated(simspec: SimSpec, decomposition: str) -> Sequence[Fault]:
    """What the description has to mention before the decomposition can rate the campaign, and so fly it."""
    from bench.errors import SetupError
    from bench.scoring import difficulty_of

    from ._scores import rated_decomposition

    tree = rated_decomposition(decomposition)
    try:
        difficulty_of(tree, simspec)
    except SetupError as error:
        return error.faults
    return ()


def _campaign(base_simspec: BaseSimSpec, decomposition: str, agents: Sequence[str]) -> dict[str, Any]:
    """A campaign over the ranges as plain values: a Latin hypercube, or every combination if there are only
    levels. It carries the text, and what was open when it was written.
    """
    from bench.campaign import Campaign
    from bench.documents import validate_document
    from bench.instance_analysis import stated_values

    factors = _factors(base_simspec.ranges)
    ranged = any("range" in factor for factor in factors)
    # A range has no levels to combine, so the points are spread over it instead.
    method = {"kind": "latin_hypercube", "points": POINTS} if ranged else {"kind": "full_factorial"}
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


def _variations(base_simspec: BaseSimSpec) -> Iterator[tuple[str, SimSpec]]:
    """Combinations of the ends of every range and of every level, up to MAX_VARIATIONS."""
    from bench.documents import validate_document
    from bench.realization import Design, situations

    if not base_simspec.ranges:
        yield "unchanged", base_simspec.simspec
        return
    factors = _factors(base_simspec.ranges)
    for factor in factors:
        if ends := factor.pop("range", None):
            clean = int if ends["integer"] else float
            factor["levels"] = [clean(ends["low"]), clean(ends["high"])]
    design = validate_document({"factors": factors}, Design, source="ranges")
    points = design.points()[:MAX_VARIATIONS]
    for point, varied in zip(points, situations(base_simspec.simspec, design, points), strict=True):
        yield ", ".join(f"{name} {level}" for name, level in point.levels.items()), varied


def _grouped(
    base_simspec: BaseSimSpec, name: str, measured: bool, folder: Path | None, agents: Sequence[str]
) -> Iterator[str]:
    """The variations in groups of equal difficulty; with a folder, a campaign of each is written there."""
    from bench.documents import dump_value

    configurations: dict[str, list[tuple[str, SimSpec]]] = {}
    group_of = _measured_group(name) if measured else _published_group(name)
    for variation, varied in _variations(base_simspec):
        configurations.setdefault(group_of(varied), []).append((variation, varied))
    if folder is not None:
        folder.mkdir(parents=True)
        manifests = [_from_folder(manifest, folder) for manifest in agents]
        for number, members in enumerate(configurations.values(), start=1):
            document = _group_campaign(base_simspec, name, manifests, [varied for _, varied in members])
            text = dump_value(document | {"name": f"{document['name']}-{number}"})
            (folder / f"group-{number}.yaml").write_text(text, encoding="utf-8")
    for number, (key, members) in enumerate(configurations.items(), start=1):
        place = "" if folder is None else f", in {folder / f'group-{number}.yaml'}"
        yield f"{key}: {len(members)} variations{place}"
        yield from (f"  {variation}" for variation, _ in members)


def _published_group(name: str) -> Callable[[SimSpec], str]:
    """The difficulty configuration of a situation, and its tension."""
    from bench.scoring import configuration_of, configuration_tension, difficulty_of

    from ._scores import rated_decomposition

    tree = rated_decomposition(name)

    def group_of(simspec: SimSpec) -> str:
        rated = difficulty_of(tree, simspec)
        return f"{configuration_of(tree, rated)} (tension {configuration_tension(tree, rated) or 'none'})"

    return group_of


def _measured_group(name: str) -> Callable[[SimSpec], str]:
    """The tension of the mean measured difficulty of all nodes with a proved scale."""
    from bench.reporting import measured_rating
    from bench.scoring import tension_of

    from ._scores import rated_decomposition

    rate = measured_rating(rated_decomposition(name))

    def group_of(simspec: SimSpec) -> str:
        difficulties = [difficulty for difficulty in rate(simspec).values() if difficulty is not None]
        # Without places for everybody a situation cannot be flown either.
        return f"tension {tension_of(fmean(difficulties))}, measured" if difficulties else "no room"

    return group_of

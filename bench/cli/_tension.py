"""The command that turns a tension into ranges of the key factors."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ._tables import print_lines

if TYPE_CHECKING:
    from decompositions import Decomposition, KeyFactor, Policies


def tension(
    node: Annotated[
        str, typer.Argument(help="Node of the decomposition, or words from the title of a key attribute")
    ],
    wanted: Annotated[int, typer.Argument(min=1, max=5, help="Tension, 1 to 5")],
    decomposition: Annotated[str, typer.Option(help="Name or file of a decomposition")] = "search-and-report",
    campaign: Annotated[
        Path | None,
        typer.Option(
            help="Campaign whose factors are drawn, to that tension by measured difficulty; with --out"
        ),
    ] = None,
    points: Annotated[int, typer.Option(min=1, help="Situations to draw with --campaign")] = 20,
    out: Annotated[Path | None, typer.Option(help="New campaign file, for --campaign")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON")] = False,
) -> None:
    """Show the ranges of the key factors that give a node a tension, or draw situations that have it.

    Example: rebar tension KA-03 4

    Example: rebar tension "bystander classification" 4

    Example: rebar tension KA-20 4 --campaign campaigns/panel.yaml --out hard.yaml
    """
    from bench.errors import SetupError

    from ._scores import rated_decomposition

    if campaign is not None or out is not None:
        node, situations = _draw(campaign, node, wanted, points, out)
        if as_json:
            print(json.dumps({"node": node, "tension": wanted, "situations": situations}, indent=2))
            return
        title = f"{len(situations)} situations of tension {wanted} for {node} by measured difficulty"
        print_lines(f"{title}, in {out}:", *(f"  {name}: {found:.0f}" for name, found in situations.items()))
        return
    tree = rated_decomposition(decomposition)
    node = _node(tree, node)
    if tree.policies.factor_rule != "minimum":
        what = "the policy factor_rule: mean lets no range of a single factor decide"
        raise SetupError(tree.name, what, "rate a SimSpec with: rebar difficulty")
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
    print_lines(*lines)
    unreached = [str(row["factor"]) for row in rows if row["from"] is None]
    if unreached or not any(row["decides"] for row in rows):
        reason = (
            f"the tables of {', '.join(unreached)} end before it" if unreached else "no factor rates so low"
        )
        print_lines(f"No situation within the tables has this tension: {reason}.")
        raise typer.Exit(1)


def _draw(
    campaign: Path | None, node: str, wanted: int, points: int, out: Path | None
) -> tuple[str, dict[str, float | None]]:
    """Write a campaign whose situations have the tension; the node's id, and the measured difficulty of each."""
    from bench.campaign import Campaign, load_campaign, load_measurable_decomposition, realizations
    from bench.documents import dump_value, validate_document
    from bench.errors import SetupError
    from bench.reporting import measured_rating

    if campaign is None or out is None:
        raise SetupError("--campaign, --out", "one is nothing without the other", "give both, or neither")
    if out.exists():
        raise SetupError(str(out), "exists", "name a new file")
    given = load_campaign(campaign)
    tree = load_measurable_decomposition(given.decomposition)
    node = _node(tree, node)
    drawn = {"kind": "stratified", "points": points, "band": 20.0, "scale": "measured"}
    # Chosen: each costs some 0.1 s, and a tension that one situation in 50 has is still found.
    drawn["candidates"] = min(20_000, max(100, 50 * points))
    drawn |= {"above": 20.0 * (wanted - 1), "up_to": 20.0 * wanted}
    document = given.model_dump(mode="json", exclude_defaults=True)
    document |= {"name": f"{given.name}-tension-{wanted}", "study": [node]}
    document["design"] = {**document.get("design", {}), "method": drawn}
    chosen = validate_document(document, Campaign, source=str(out))
    rate = measured_rating(tree, [node])
    plans = {plan.design_point: plan for plan in realizations(chosen)}
    out.write_text(dump_value(document), encoding="utf-8")
    return node, {name: rate(plan.situation)[node] for name, plan in plans.items()}


def _node(tree: Decomposition, words: str) -> str:
    """The node with that id, or the only key attribute whose title has all of these words."""
    from bench.errors import SetupError
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
        what = f"{len(matches)} key attributes have {words!r} in their title"
        raise SetupError("NODE", what, f"name one; matches: {choices}")
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
    tables: dict[str, list[KeyFactor]] = {}
    for leaf in tree.observables_under(node):
        # In no SimSpec do those about the bench's detections count for another node than themselves (ruling 25).
        if leaf == node or tree.observables[leaf].subject != "perception":
            for row in tree.key_factors(leaf):
                tables.setdefault(row.factor, []).append(row)
    for factor, rows in tables.items():
        yield {"factor": factor, "unit": rows[0].unit, **_range_of(rows, wanted, tree.policies)}


def _range_of(rows: Sequence[KeyFactor], wanted: int, policies: Policies) -> dict[str, Any]:
    """The ends of one factor's range in its tables, and whether the factor decides."""
    from bench.scoring import hardest_value, value_for_rating

    rises = rows[0].values[-1] > rows[0].values[0]
    sign = 1.0 if rises else -1.0
    # Tension 1 begins at the easy end of every table, so nothing has to be exceeded.
    lows = [
        value_for_rating(row, 20.0 * (wanted - 1), policies, exceeded=True)
        if wanted > 1
        else (row.values[0], False)
        for row in rows
    ]
    reached = [low for low in lows if low is not None]
    begin: tuple[float | None, bool] = (None, False)
    if len(reached) == len(lows):
        begin = max(reached, key=lambda low: (sign * low[0], low[1]))
    highs = [high for row in rows if (high := hardest_value(row, 20.0 * wanted, policies))]
    to, before = max(highs, key=lambda high: (sign * high[0], not high[1]), default=(-sign * math.inf, True))
    value, is_past = begin
    decides = value is not None and (sign * value < sign * to or (value == to and not is_past and not before))
    return {
        "rises": rises,
        "from": value,
        "from_past": is_past,
        "to": to if decides and math.isfinite(to) else None,
        "to_before": decides and before,
        "decides": decides,
    }

"""The file of a proposed campaign: YAML with the reasons as comments."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from bench.documents import dump_value
from bench.visible_text import visible

from .._document import Campaign
from ._factor_rules import FactorProposal

WIDTH = 80
"""Characters in a line: the file is read in a terminal before it is run."""


def campaign_file(
    proposed: Campaign, previous: Campaign, factors: Sequence[FactorProposal], reasons: Mapping[str, str]
) -> str:
    """The text of the file. `factors` are those of `previous` in order, `reasons` those of the design by field.

    What a person reviews comes first, the base SimSpec last.
    """
    document = proposed.model_dump(mode="json")
    design, base = _set_fields(document.pop("design")), document.pop("base")
    situations = [_set_fields(situation) for situation in document.pop("situations")]
    document["agents"] = [_set_fields(agent) for agent in document["agents"]]
    document["budgets"] = _set_fields(document["budgets"])
    head = _comment(
        f"Proposed from the results of {previous.name}: a draft to review, change and then run. Comments give the reasons; "
        "docs/designs.md has the rules."
    )
    parts = [head, _yaml(_set_fields(document)), "design:\n"]
    for name in ("seed", "replicates", "method", "forbid"):
        if name in design:
            # `take` is a field of the method, so its reason stands above the method.
            fields = (name, "take") if name == "method" else (name,)
            value = _set_fields(design[name]) if name == "method" else design[name]
            parts += [_comment(reasons[field], 2) for field in fields if field in reasons]
            parts.append(_yaml({name: value}, 2))
    parts.append("  factors:\n")
    remaining = iter(design["factors"])
    for proposal, factor in zip(factors, previous.design.factors, strict=True):
        parts += [_comment(f"{factor.name}: {reason}", 4) for reason in proposal.reasons]
        if proposal.factor:
            parts.append(_yaml([_set_fields(next(remaining))], 4))
    if situations:
        return "".join([*parts, _comment("The situations, unchanged."), _yaml({"situations": situations})])
    return "".join([*parts, _comment("The situation, unchanged."), _yaml({"base": base})])


def _set_fields(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Without fields that are absent, empty or off, which have no effect."""
    present = {
        name: _set_fields(value) if name == "range" else value
        for name, value in fields.items()
        if value is not None
    }
    return {
        name: value for name, value in present.items() if value is not False and value not in ([], {}, "")
    }


def _yaml(value: object, indent: int = 0) -> str:
    return textwrap.indent(dump_value(value, WIDTH - indent), " " * indent)


def _comment(text: str, indent: int = 0) -> str:
    margin = " " * indent + "# "
    # A separator of lines that is not seen would end the comment.
    return textwrap.fill(visible(text), width=WIDTH, initial_indent=margin, subsequent_indent=margin) + "\n"

"""Proposes the campaign to fly after a finished one: a campaign file with its reasons, for a person to review.

By fixed rules: a factor is removed if it has no effect and the runs would have shown one, a range is narrowed
to where passing is undecided, and replicates are added where little is known. What was chosen from results is
flown with another seed, so that it is not judged by the same results.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from bench.documents import read_document
from bench.errors import Fault, SetupError
from bench.reporting import ReportData, load_report_data

from .._document import Campaign
from ..results._finish import read_campaign_folder
from ._campaign_file import campaign_file
from ._design_rules import propose_design
from ._factor_evidence import FactorEvidence
from ._factor_rules import FactorProposal, propose_factor


@dataclass(frozen=True, slots=True)
class CampaignProposal:
    """The next campaign.

    `changes` are sentences, none if nothing but the seed changes. `text` is the whole file.
    """

    campaign: Campaign
    changes: tuple[str, ...]
    text: str


def propose_next(folder: Path, output_folder: Path | None = None) -> CampaignProposal:
    """The next campaign after the one in `folder`, as a file for `output_folder`, by default the working folder.

    Raises SetupError if the folder is not a campaign, is not finished, or varies nothing.
    """
    paths, previous, _ = read_campaign_folder(folder)
    data = load_report_data(folder)
    _check_finished(folder, previous, data)
    evidence = FactorEvidence.of(data, previous.design)
    old_factors = previous.design.factors
    factors = [propose_factor(factor, previous.design, evidence) for factor in old_factors]
    # Without any factor there would be no design to propose.
    if not any(proposal.factor for proposal in factors):
        factors = [FactorProposal(factor, ("stays: no factor shows an effect",)) for factor in old_factors]
    design, reasons = propose_design(
        previous.design, [proposal.factor for proposal in factors if proposal.factor], data
    )
    decomposition = paths.decomposition if (folder / previous.decomposition).is_file() else None
    proposed = previous.model_copy(
        update={
            "name": _next_name(previous.name),
            "design": design,
            "decomposition": os.path.relpath(decomposition, output_folder or Path.cwd())
            if decomposition
            else previous.decomposition,
        }
    )
    changes = [
        f"{factor.name}: {proposal.reasons[0]}"
        for proposal, factor in zip(factors, old_factors, strict=True)
        if proposal.factor != factor
    ]
    changes += [reasons[name] for name in ("method", "replicates", "take") if name in reasons]
    text = campaign_file(proposed, previous, factors, reasons)
    # Raises if the proposal could not be run: better here than in the user's hands.
    read_document(text, Campaign)
    return CampaignProposal(proposed, tuple(changes), text)


def _check_finished(folder: Path, campaign: Campaign, data: ReportData) -> None:
    waiting = sum(run.outcome is None for run in data.runs)
    faults = []
    if not campaign.design.factors:
        faults.append(
            Fault(
                str(folder),
                "varies no factor, so there is no next design to propose",
                "give its design factors",
            )
        )
    if waiting:
        faults.append(
            Fault(
                str(folder), f"has {waiting} realizations without a result", "run them first with `rebar run`"
            )
        )
    elif not data.scores.height:
        faults.append(Fault(str(folder), "has no scores", "score it first with `rebar score`"))
    if faults:
        raise SetupError(faults)


def _next_name(name: str) -> str:
    """The name with -next, or with the next number after it. At most 63 characters, as identifiers are."""
    match = re.fullmatch(r"(.*)-next(?:-(\d+))?", name)
    stem, number = (match[1], int(match[2] or 1) + 1) if match else (name, 1)
    suffix = "-next" if number == 1 else f"-next-{number}"
    return stem[: 63 - len(suffix)] + suffix

"""The campaign file: the situation, its design, the agents under test, and the decomposition."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document, load_document
from bench.realization import Design
from bench.simspec import AgentSpec, Identifier, SimSpec


class CampaignBudgets(Document):
    """How much of the host a campaign may use.

    Only `wall_s` is part of what is flown; the others may change between runs.
    """

    workers: Annotated[
        int | None, Field(ge=1, le=1024, description="Sessions at once; the number of cores if absent.")
    ] = None
    wall_s: Annotated[
        float | None,
        Field(
            gt=0.0, le=86400.0, description="Host seconds for one session, in place of the base SimSpec's."
        ),
    ] = None
    total_wall_s: Annotated[
        float | None,
        Field(
            gt=0.0, description="Host seconds after which no further session is started; run again to resume."
        ),
    ] = None


class Stopping(Document):
    """When a design point stops early: once the pass rate of a node is certain to be above or below a
    threshold.

    Decided after every replicate, for each agent separately, by an interval that holds for all these
    decisions together.
    """

    node: Annotated[str, Field(description="Node of the decomposition whose pass rate is decided.")]
    threshold: Annotated[float, Field(gt=0.0, lt=1.0, description="Pass rate to be above or below.")]
    level: Annotated[
        float,
        Field(ge=0.5, lt=1.0, description="Probability that the decision about a design point is right."),
    ] = 0.95
    look: Annotated[
        Literal["design_point"],
        Field(description="What is decided about: the replicates of one design point."),
    ] = "design_point"


class Campaign(Document):
    """A campaign: base SimSpec, design, agents and decomposition. Every agent flies every scene."""

    format: Literal["rebar.campaign/1"] = "rebar.campaign/1"
    name: Identifier
    description: str = ""
    base: Annotated[
        SimSpec | None, Field(description="The situation that the design varies; or base_file.")
    ] = None
    base_file: Annotated[
        str | None, Field(description="Path of a SimSpec, relative to the campaign file; in place of base.")
    ] = None
    design: Design = Design()
    agents: Annotated[tuple[AgentSpec, ...], Field(min_length=1, description="The agents under test.")]
    decomposition: Annotated[
        str, Field(description="Name of a decomposition, or its path relative to the campaign file.")
    ] = "search-and-report"
    fidelity: Annotated[
        Literal["full", "overhead"],
        Field(description="full: co-simulation; overhead: surrogates of the agents on a ground plan."),
    ] = "full"
    study: Annotated[
        tuple[str, ...],
        Field(description="Nodes that the report is about; those of the decomposition if empty."),
    ] = ()
    stopping: Annotated[
        Stopping | None,
        Field(description="Stop a design point once its pass rate is decided; off if absent."),
    ] = None
    budgets: CampaignBudgets = CampaignBudgets()

    @model_validator(mode="after")
    def _one_base(self) -> Self:
        if (self.base is None) == (self.base_file is None):
            raise ValueError(
                "give either base (a SimSpec) or base_file (the path of one, relative to this file)"
            )
        return self

    @property
    def situation(self) -> SimSpec:
        """The base SimSpec with the campaign's budgets. Only for a campaign from `load_campaign`."""
        assert self.base is not None, "load_campaign replaces base_file by base"
        if self.budgets.wall_s is None:
            return self.base
        return self.base.model_copy(
            update={"budgets": self.base.budgets.model_copy(update={"wall_s": self.budgets.wall_s})}
        )


def load_campaign(path: Path | str) -> Campaign:
    """Read a campaign. Relative paths in it are relative to its own folder, and base_file is replaced by its
    content.

    Raises SetupError with every fault: file, line, field, remedy.
    """
    path = Path(path)
    campaign = load_document(path, Campaign)
    parent = path.resolve().parent
    agents = tuple(
        agent.model_copy(update={"manifest": _resolved(parent, agent.manifest)}) for agent in campaign.agents
    )
    # Absolute paths: the campaign is copied into its folder, where relative ones would lead elsewhere.
    changes: dict[str, object] = {
        "agents": agents,
        "decomposition": _resolved(parent, campaign.decomposition),
    }
    if campaign.base_file is not None:
        changes |= {"base": load_document(parent / campaign.base_file, SimSpec), "base_file": None}
    return campaign.model_copy(update=changes)


def _resolved(parent: Path, name: str) -> str:
    """The absolute path of a file in the campaign's folder.

    A name without such a file is a plug-in's and stays.
    """
    return str(parent / name) if (parent / name).is_file() else name

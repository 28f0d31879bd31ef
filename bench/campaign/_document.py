"""The campaign as a person writes it: which situation, how varied, who flies it, what is asked."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document, load_document
from bench.realization import Design
from bench.simspec import AgentSpec, Identifier, SimSpec


class CampaignBudgets(Document):
    """How much of the host a campaign may use. Only `wall_s` changes what is flown; the others may differ from run to run."""

    workers: Annotated[
        int | None, Field(ge=1, le=1024, description="Sessions at once; as many as there are cores when absent.")
    ] = None
    wall_s: Annotated[
        float | None, Field(gt=0.0, le=86400.0, description="Host seconds for one session, in place of the base SimSpec's.")
    ] = None
    total_wall_s: Annotated[
        float | None, Field(gt=0.0, description="Host seconds after which no further session is begun; run again to go on.")
    ] = None


class Stopping(Document):
    """When a design point's replicates end: once the pass rate of a node lies wholly on one side of a threshold.

    Looked at after every replicate, by an interval that holds at all looks at once; each agent for itself.
    """

    node: Annotated[str, Field(description="Node of the decomposition whose pass rate is asked about.")]
    threshold: Annotated[float, Field(gt=0.0, lt=1.0, description="Pass rate on one side of which the question is settled.")]
    level: Annotated[float, Field(ge=0.5, lt=1.0, description="A design point's verdict is right with this probability.")] = 0.95
    look: Annotated[Literal["design_point"], Field(description="What is looked at: the replicates of one design point.")] = (
        "design_point"
    )


class Campaign(Document):
    """A campaign: base SimSpec, design, agents, decomposition. Every agent flies every scene."""

    format: Literal["rebar.campaign/1"] = "rebar.campaign/1"
    name: Identifier
    description: str = ""
    base: Annotated[SimSpec | None, Field(description="The situation that the design varies; or base_file.")] = None
    base_file: Annotated[str | None, Field(description="A SimSpec beside the campaign's file, in place of base.")] = None
    design: Design = Design()
    agents: Annotated[tuple[AgentSpec, ...], Field(min_length=1, description="The agents under test.")]
    decomposition: Annotated[str, Field(description="Name of a decomposition, or a file beside the campaign's.")] = (
        "search-and-report"
    )
    fidelity: Annotated[
        Literal["full", "overhead"],
        Field(description="full co-simulation, or the overhead one: surrogates of the reference agents on a ground plan."),
    ] = "full"
    study: Annotated[
        tuple[str, ...], Field(description="Nodes that the report is about; the decomposition's own when empty.")
    ] = ()
    stopping: Annotated[Stopping | None, Field(description="End a design point once it is settled; off when absent.")] = None
    budgets: CampaignBudgets = CampaignBudgets()

    @model_validator(mode="after")
    def _one_base(self) -> Self:
        if (self.base is None) == (self.base_file is None):
            raise ValueError("give either base (a SimSpec written out) or base_file (a path beside this file)")
        return self

    @property
    def situation(self) -> SimSpec:
        """The base SimSpec with the campaign's budgets; only for a campaign whose base_file has been read in."""
        assert self.base is not None, "load_campaign reads base_file in"
        if self.budgets.wall_s is None:
            return self.base
        return self.base.model_copy(update={"budgets": self.base.budgets.model_copy(update={"wall_s": self.budgets.wall_s})})


def load_campaign(path: Path | str) -> Campaign:
    """Read a campaign; what it names as files beside it is found from where it lies, and base_file is read in.

    Raises SetupError with every fault: file, line, field, mend.
    """
    path = Path(path)
    campaign = load_document(path, Campaign)
    beside = path.resolve().parent
    agents = tuple(agent.model_copy(update={"manifest": _found(beside, agent.manifest)}) for agent in campaign.agents)
    changes: dict[str, object] = {"agents": agents, "decomposition": _found(beside, campaign.decomposition)}
    if campaign.base_file is not None:
        changes |= {"base": load_document(beside / campaign.base_file, SimSpec), "base_file": None}
    return campaign.model_copy(update=changes)


def _found(beside: Path, name: str) -> str:
    """The whole path of a file beside the campaign; a name that is no such file stays as it is."""
    return str(beside / name) if (beside / name).is_file() else name

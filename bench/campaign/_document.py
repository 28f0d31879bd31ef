"""The campaign file: the situation, its design, the agents under test, and the decomposition."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from bench.agents import installed_agents
from bench.documents import Document, added_field, is_default, load_document, validate_document
from bench.errors import Fault, SetupError
from bench.realization import BASE, Bases, Design, DesignFactor, with_number_levels
from bench.simspec import AgentSpec, Identifier, Isolation, PaceMode, SimSpec, is_manifest_file


class CampaignBudgets(Document):
    """How much of the host a campaign may use.

    Only `wall_s` is part of what is flown; the others may change between runs.
    """

    workers: int | None = Field(
        None, ge=1, le=1024, description="Sessions at once; the number of cores if absent."
    )
    wall_s: float | None = Field(
        None, gt=0.0, le=86400.0, description="Host seconds for one session, in place of the base SimSpec's."
    )
    total_wall_s: float | None = Field(
        None,
        gt=0.0,
        description="Host seconds after which no further session is started; run again to resume.",
    )
    retry_s: float = Field(
        60.0,
        ge=0.0,
        le=86400.0,
        description="Host seconds over which a session that the host may have cost is tried again, with pauses that grow; "
        "0 for one retry at once.",
    )


class Stopping(Document):
    """When a design point stops early: once the pass rate of a node is certain to be above or below a threshold.

    Decided after every replicate, for each agent separately, by an interval that holds for all these
    decisions together.
    """

    node: str = Field(description="Node of the decomposition whose pass rate is decided.")
    threshold: float = Field(gt=0.0, lt=1.0, description="Pass rate to be above or below.")
    level: float = Field(
        0.95, ge=0.5, lt=1.0, description="Probability that the decision about a design point is right."
    )


def _floor_agents() -> tuple[AgentSpec, ...]:
    return tuple(AgentSpec(manifest=name) for name in installed_agents("floor"))


def _ceiling_agent() -> AgentSpec | None:
    return next((AgentSpec(manifest=name) for name in installed_agents("ceiling")), None)


class FloorPlan(Document):
    """Agents that show what confidence can be had without merit, and with the truth.

    They fly a share of the campaign's scenes beside the agents under test, and never count as such.
    """

    agents: tuple[AgentSpec, ...] = Field(
        default_factory=_floor_agents,
        min_length=1,
        description="The null agents; if absent, all installed ones whose manifest has the role floor.",
    )
    oracle: AgentSpec | None = Field(
        default_factory=_ceiling_agent,
        description="The agent that is given the truth, null for none; if absent, the first installed one whose manifest has the role ceiling.",
    )
    share: float = Field(
        0.1, gt=0.0, le=1.0, description="Share of the scenes, drawn from the design's seed."
    )
    least_scenes: int = Field(
        5,
        ge=1,
        # 0.05 ** (1 / 5) is 0.55, so five is the fewest for which this holds.
        description="Scenes at least. An agent that passes all of five shows a rate above a half with 95 %.",
    )

    @property
    def specs(self) -> tuple[AgentSpec, ...]:
        """The null agents, and the oracle after them."""
        return self.agents if self.oracle is None else (*self.agents, self.oracle)


class Honeypots(Document):
    """Targets that are nowhere but in the SimSpecs, so that an agent which reports one has read them.

    They change nothing that an agent can see, and no measure.
    """

    share: float = Field(
        0.1, gt=0.0, le=1.0, description="Share of the scenes, drawn from the design's seed."
    )


SITUATION = "situation"
"""Name of the design factor that a campaign with several situations has, if it states no other."""


class Situation(Document):
    """One of the base situations of a campaign."""

    name: Identifier = Field(description="The level of the factor `situation`.")
    base: SimSpec | None = Field(None, description="The base SimSpec; or base_file.")
    base_file: str | None = Field(
        None, description="Path of a SimSpec, relative to the campaign file; in place of base."
    )
    tension: int | None = Field(
        None, ge=1, le=5, description="The tension that it is built for: of its nodes under study."
    )

    @model_validator(mode="after")
    def _one_base(self) -> Self:
        if (self.base is None) == (self.base_file is None):
            raise ValueError(
                f"situation {self.name!r}: give either base (a SimSpec) or base_file (the path of one)"
            )
        return self


class Keep(Document):
    """Which recordings stay once their results are there. Results, scores and digests always do."""

    recordings: Literal["all", "failures", "none"] = Field(
        "all",
        description="`failures`: of sessions that did not complete, or did not pass every node under study that "
        "they considered.",
    )
    sample: float = Field(
        0.0, ge=0.0, le=1.0, description="Share of the others that is kept too, drawn from the design's seed."
    )


class CampaignAgent(AgentSpec):
    """An agent under test, as a campaign names it."""

    pace: PaceMode | None = added_field(
        None, "Pace of this agent's runs, in place of the campaign's and of the base SimSpec's."
    )

    @property
    def spec(self) -> AgentSpec:
        """The agent as its SimSpecs have it; they state their pace themselves."""
        return AgentSpec.model_validate(self.model_dump(exclude={"pace"}))


class Campaign(Document):
    """A campaign: base SimSpec, design, agents and decomposition. Every agent flies every scene."""

    format: Literal["rebar.campaign/1"] = "rebar.campaign/1"
    name: Identifier
    description: str = ""
    base: SimSpec | None = Field(None, description="The situation that the design varies; or base_file.")
    base_file: str | None = Field(
        None, description="Path of a SimSpec, relative to the campaign file; in place of base."
    )
    situations: tuple[Situation, ...] = Field(
        (),
        max_length=1000,
        description="Several base situations, in place of base: a factor `situation` of the design chooses.",
    )
    design: Design = Design()
    agents: tuple[CampaignAgent, ...] = Field(min_length=1, description="The agents under test.")
    decomposition: str = Field(
        "search-and-report", description="Name of a decomposition, or its path relative to the campaign file."
    )
    fidelity: Literal["full", "overhead"] = Field(
        "full", description="full: co-simulation; overhead: surrogates of the agents on a ground plan."
    )
    study: tuple[str, ...] = Field(
        (), description="Nodes that the report is about; those of the decomposition if empty."
    )
    stopping: Stopping | None = Field(
        None, description="Stop a design point once its pass rate is decided; off if absent."
    )
    floor: FloorPlan | None = Field(
        None,
        description="Fly null agents and an oracle on a share of the scenes; true for the installed ones.",
    )
    pace: PaceMode | None = Field(
        None,
        description="Pace of all runs, in place of the base SimSpec's; every agent without a pace of its own must follow it.",
    )
    isolation: Isolation | None = Field(
        None, description="How every agent must be confined, in place of what its manifest says."
    )
    honeypots: Honeypots | None = Field(
        None,
        exclude_if=is_default(None),
        description="Put honeypots into a share of the scenes; none if absent.",
    )
    keep: Keep | None = Field(
        None, exclude_if=is_default(None), description="Which recordings stay; all if absent."
    )
    shard: str | None = Field(
        None,
        exclude_if=is_default(None),
        description="`2/8`: this folder holds the second of eight parts of the campaign. Set by --shard.",
    )
    budgets: CampaignBudgets = CampaignBudgets()

    @field_validator("shard")
    @classmethod
    def _shard_is_one_of_several(cls, shard: str | None) -> str | None:
        if shard is not None:
            parse_shard(shard)
        return shard

    @model_validator(mode="before")
    @classmethod
    def _situations_are_a_factor(cls, value: Any) -> Any:
        # Before the design is validated: its other factors, `forbid` and `take` may speak of the situation.
        situations = value.get("situations") if isinstance(value, dict) else None
        design = value.get("design", {}) if situations else None
        if isinstance(design, Design):
            design = design.model_dump()
        if not isinstance(design, dict) or not isinstance(situations, (list, tuple)):
            return value
        factors = design.get("factors", ())
        if not isinstance(factors, (list, tuple)) or any(map(_sets_base, factors)):
            return value
        names = [
            situation.name if isinstance(situation, Situation) else situation.get("name")
            for situation in situations
            if isinstance(situation, (Situation, dict))
        ]
        # Last, so that the lines of faults in the factors above stay right.
        factor = {"name": SITUATION, "levels": list(dict.fromkeys(names)), "sets": [BASE]}
        return {**value, "design": {**design, "factors": [*factors, factor]}}

    @field_validator("situations")
    @classmethod
    def _situations_differ(cls, situations: tuple[Situation, ...]) -> tuple[Situation, ...]:
        names = Counter(situation.name for situation in situations)
        if twice := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"two situations are called {twice[0]!r}")
        return situations

    @field_validator("floor", mode="before")
    @classmethod
    def _floor_as_document(cls, value: object) -> object:
        # YAML's `floor: true` is the plan with its defaults, `floor: false` none.
        if isinstance(value, bool):
            return FloorPlan() if value else None
        return value

    @model_validator(mode="after")
    def _floor_beside_agents(self) -> Self:
        if self.floor is None:
            return self
        if self.fidelity != "full":
            raise ValueError("floor needs fidelity: full, because null agents have no surrogates")
        labels = [agent.label for agent in (*self.agents, *self.floor.specs)]
        twice = [label for label in labels if labels.count(label) > 1]
        if twice:
            raise ValueError(
                f"{twice[0]!r} is named twice among agents and floor: a null agent under test is no floor; "
                "take it out of one of them (floor: {agents: [...]} names others)"
            )
        return self

    @model_validator(mode="after")
    def _one_base(self) -> Self:
        if (self.base is not None) + (self.base_file is not None) + bool(self.situations) != 1:
            raise ValueError(
                "give either base (a SimSpec), base_file (the path of one, relative to this file) or situations (several)"
            )
        return self

    @property
    def floor_labels(self) -> frozenset[str]:
        """Labels of the agents that fly for the floor: their runs are no results of the agents under test."""
        return frozenset(agent.label for agent in self.floor.specs) if self.floor else frozenset()

    @property
    def oracle_label(self) -> str | None:
        """Label of the agent that is given the truth, None without one."""
        return self.floor.oracle.label if self.floor and self.floor.oracle else None

    @property
    def bases(self) -> Bases:
        """The base SimSpec, or those of all situations by name, with the campaign's budgets and pace.

        Only for a campaign from `load_campaign`.
        """
        if not self.situations:
            return self._adjusted(self.base)
        return {situation.name: self._adjusted(situation.base) for situation in self.situations}

    def _adjusted(self, base: SimSpec | None) -> SimSpec:
        assert base is not None, "load_campaign replaces base_file by base"
        changes: dict[str, object] = {}
        if self.budgets.wall_s is not None:
            changes["budgets"] = base.budgets.model_copy(update={"wall_s": self.budgets.wall_s})
        if self.pace is not None:
            changes["pace"] = base.pace.model_copy(update={"mode": self.pace})
        return base.model_copy(update=changes) if changes else base


def parse_shard(shard: str) -> tuple[int, int]:
    """The number of a shard, from 1, and of how many it is one. Raises ValueError."""
    match = re.fullmatch(r"([1-9]\d{0,5})/([1-9]\d{0,5})", shard, re.ASCII)
    if match is None or int(match[1]) > int(match[2]):
        raise ValueError(f"{shard!r} is no shard: write 2/8 for the second of eight")
    return int(match[1]), int(match[2])


def _sets_base(factor: object) -> bool:
    if isinstance(factor, DesignFactor):
        return factor.chooses_base
    sets = factor.get("sets") if isinstance(factor, dict) else None
    return isinstance(sets, (list, tuple)) and BASE in sets


def with_floor(campaign: Campaign) -> Campaign:
    """The campaign with the installed null agents and the oracle beside its agents, if it names no others.

    Raises SetupError if one of them is an agent under test, or no session is flown.
    """
    if campaign.floor is not None:
        return campaign
    document = {**campaign.model_dump(mode="json"), "floor": FloorPlan().model_dump(mode="json")}
    return validate_document(document, Campaign, source="--floor")


def load_campaign(path: Path | str) -> Campaign:
    """Read a campaign. Relative paths in it are relative to its own folder, and base_file is replaced by its content.

    Raises SetupError with every fault: file, line, field, remedy.
    """
    path = Path(path)
    campaign = load_document(path, Campaign)
    parent = path.resolve().parent

    def resolved(agent: AgentSpec) -> AgentSpec:
        manifest = agent.manifest
        path = str(parent / manifest) if is_manifest_file(manifest) else _resolved(parent, manifest)
        return agent.model_copy(update={"manifest": path})

    # Absolute paths: the campaign is copied into its folder, where relative ones would lead elsewhere.
    changes: dict[str, object] = {
        "agents": tuple(map(resolved, campaign.agents)),
        "decomposition": _resolved(parent, campaign.decomposition),
    }
    if campaign.floor is not None:
        floor = campaign.floor
        null, oracle = tuple(map(resolved, floor.agents)), floor.oracle and resolved(floor.oracle)
        changes["floor"] = floor.model_copy(update={"agents": null, "oracle": oracle})
    if campaign.base_file is not None:
        changes |= {"base": load_document(parent / campaign.base_file, SimSpec), "base_file": None}
    if campaign.situations:
        changes["situations"] = _with_bases(parent, campaign.situations)
    campaign = campaign.model_copy(update=changes)
    return campaign.model_copy(update={"design": with_number_levels(campaign.bases, campaign.design)})


def _with_bases(parent: Path, situations: tuple[Situation, ...]) -> tuple[Situation, ...]:
    """The situations with the content of their files. Raises SetupError with the faults of all files."""
    faults: list[Fault] = []
    loaded = []
    for situation in situations:
        if situation.base_file is not None:
            try:
                base = load_document(parent / situation.base_file, SimSpec)
            except SetupError as error:
                faults += error.faults
                continue
            situation = situation.model_copy(update={"base": base, "base_file": None})
        loaded.append(situation)
    if faults:
        raise SetupError(faults)
    return tuple(loaded)


def _resolved(parent: Path, name: str) -> str:
    """The absolute path of a file in the campaign's folder.

    A name without such a file is a plug-in's and stays.
    """
    return str(parent / name) if (parent / name).is_file() else name


# Whose agents fly, within which time of the host, and what the campaign is called changes no scene, nor does where it is
# flown; a honeypot changes nothing that is seen or measured.
NOT_ASKED = {"name", "description", "agents", "floor", "budgets", "honeypots", "keep", "shard"}
SITUATIONS = {"base", "situations"}


def question_sha256(campaign: Campaign) -> str:
    """SHA-256, in hexadecimal, over situations in full, design, decomposition, study and stopping.

    The same for a campaign file and for the `campaign.yaml` of a folder that was flown from it.
    """
    # Situations in full: a changed default of a SimSpec changes what is flown. Of the rest only what is stated, so
    # that a new option of campaigns leaves the digests of those without it alone.
    question: dict[str, Any] = campaign.model_dump(mode="json", include=SITUATIONS)
    question |= campaign.model_dump(mode="json", exclude=NOT_ASKED | SITUATIONS, exclude_defaults=True)
    return hashlib.sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()

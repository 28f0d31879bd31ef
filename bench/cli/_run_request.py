"""What `rebar run` is asked, and the changes that its options make to a campaign."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.errors import SetupError

from ._laboratory import LaboratoryOptions

if TYPE_CHECKING:
    from bench.campaign import Campaign

Workers = Annotated[int | None, typer.Option(min=1, help="Sessions at once. Default: the number of cores")]
Pace = Literal["lockstep", "realtime", "warp"]
IsolationOption = Annotated[
    Literal["auto", "landlock", "none"] | None,
    typer.Option(help="How every agent must be confined, in place of what its manifest says (rebar doctor)"),
]


def manifest_of(agent: str) -> str:
    """The manifest of an agent by its name, file or folder; in a folder it has the folder's name, as `rebar agent new` writes it."""
    path = Path(agent)
    if path.is_dir():
        path = path.resolve() / f"{path.resolve().name}.yaml"
        if not path.is_file():
            raise SetupError(agent, f"the folder holds no {path.name}", "name the manifest itself")
    return str(path.resolve()) if path.is_file() else agent


@dataclass(frozen=True, slots=True)
class CampaignChanges:
    """What options say in place of the campaign file."""

    agents: Annotated[
        list[str] | None,
        typer.Option(
            "--agent",
            metavar="FOLDER|MANIFEST|NAME",
            help="Fly this agent, in place of all of the campaign's; one of these keeps its options. Repeatable",
        ),
    ] = None
    floor: Annotated[
        bool,
        typer.Option(
            "--floor",
            help="Fly null agents and an oracle on a share of the scenes as well, to see what needs no merit",
        ),
    ] = False
    pace: Annotated[
        Pace | None,
        typer.Option(
            help="Pace of all runs, in place of the situation's and of each agent's own. A folder keeps the pace it was flown at"
        ),
    ] = None
    isolation: IsolationOption = None
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Fly the I-th of N parts of the campaign, in a folder of its own; `rebar merge` joins them",
        ),
    ] = None
    points: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Try so many design points or a few more, evenly chosen, before the night: the first of so many shards",
        ),
    ] = None

    def load(self, path: Path) -> Campaign:
        """The campaign of a file, changed. Raises SetupError for a shard that cannot be."""
        from bench.campaign import Campaign, load_campaign, parse_shard, with_floor
        from bench.documents import validate_document

        campaign = load_campaign(path)
        if self.agents:
            document = campaign.model_dump(mode="json")
            # An agent of the campaign keeps its options.
            known = {
                spec.label: entry for spec, entry in zip(campaign.agents, document["agents"], strict=True)
            }
            document["agents"] = [
                known.get(agent) or {"manifest": manifest_of(agent)} for agent in self.agents
            ]
            campaign = validate_document(document, Campaign, source="--agent")
        if self.shard is not None:
            try:
                parse_shard(self.shard)
            except ValueError as error:
                raise SetupError("--shard", str(error), "number the shards from 1") from None
        if self.pace is not None:
            unpaced = tuple(agent.model_copy(update={"pace": None}) for agent in campaign.agents)
            campaign = campaign.model_copy(update={"agents": unpaced})
        shard = self.shard if self.points is None else self._tried(campaign, self.points)
        options = {"pace": self.pace, "isolation": self.isolation, "shard": shard}
        campaign = campaign.model_copy(
            update={name: value for name, value in options.items() if value is not None}
        )
        return with_floor(campaign) if self.floor else campaign

    def _tried(self, campaign: Campaign, count: int) -> str:
        from bench.campaign import realizations

        if self.shard is not None:
            raise SetupError("--points", "chooses a shard, and --shard names one", "give one of them")
        points = {plan.design_point for plan in realizations(campaign)}
        return f"1/{max(1, len(points) // count)}"


@dataclass(frozen=True, slots=True)
class RunRequest:
    """The options of `rebar run`."""

    out: Annotated[Path | None, typer.Option(help="Folder of the campaign. Default: out/NAME")] = None
    workers: Workers = None
    again: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OUTCOME",
            help="Take back --accept: fly realizations with this outcome again. Repeatable",
        ),
    ] = None
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="OUTCOME",
            help="Go without the runs that have this outcome now, for example bench_error. Repeatable",
        ),
    ] = None
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Fly nothing. Print what would be flown, and what surrogates expect of it"
        ),
    ] = False
    changes: CampaignChanges = field(default_factory=CampaignChanges)
    session_s: Annotated[
        float | None,
        typer.Option(
            "--session-s",
            min=0.001,
            help="Host seconds of a core for one session, to estimate the cost with --dry-run",
        ),
    ] = None
    events: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Append every event to this file as a line of JSON"),
    ] = None
    laboratory: LaboratoryOptions = field(default_factory=LaboratoryOptions)
    as_json: Annotated[bool, typer.Option("--json", help="Print the scores as JSON")] = False

    def folder(self, campaign: Campaign) -> Path:
        """The folder of a campaign that was loaded with the changes."""
        part = f"-{campaign.shard.replace('/', '-of-')}" if campaign.shard else ""
        return self.out or Path("out") / (campaign.name + part)

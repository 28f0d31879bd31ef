"""The SimSpec: everything that decides what happens in one session, as a document.

A *base* SimSpec says what is wanted (groups of actors and the relations between them); a *realized* one carries
beside that intent the exact place of every actor, in `realized`. Difficulty is read from the intent, the session
flies the realization, and both stand in one file.

Frames: positions are east/north metres in the local tangent plane at `world.origin` (ROS REP 103 ENU); headings
are degrees clockwise from true north. Degrees and per-mille units exist only in documents; the code works in SI.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._actors import ActorGroup
from ._consistency import raise_inconsistencies, situation_inconsistencies
from ._ground import World
from ._quantities import Fraction, Identifier, Metres, NotNegative, Positive
from ._rules import Rules
from ._vehicle import VehicleSpec
from ._weather import Environment


class Intelligence(Document):
    """One report handed to the agent: roughly where something of interest was seen."""

    id: Identifier
    about: Annotated[Identifier, Field(description="The group whose first member is meant. Never told to the agent.")]
    priority: Annotated[int, Field(ge=1, le=9, description="1 is the most urgent.")] = 1
    uncertainty_m: Annotated[Positive, Field(description="Radius of the sub-area to search; the true place lies inside it.")] = (
        60.0
    )
    latency_s: Annotated[NotNegative, Field(description="Age of the sighting when it is delivered.")] = 0.0
    delivered_s: Annotated[NotNegative, Field(description="Simulated time of delivery.")] = 0.0


class Mission(Document):
    """What the agent is asked to do."""

    kind: Literal["search_and_report"] = "search_and_report"
    altitude_m: Annotated[float, Field(gt=1.0, le=6000.0, description="Configured mission height above home.")] = 60.0
    speed_mps: Annotated[float, Field(gt=0.0, le=30.0)] = 12.0
    time_limit_s: Annotated[float, Field(gt=0.0, le=7200.0)] = 300.0
    return_home: bool = True


OrderKind = Literal["hold", "resume", "return", "abort", "deactivate", "retask", "stop_reporting", "resume_reporting", "mark"]


class Order(Document):
    """One order of the operator during the flight, to be carried out within `within_s` of its delivery.

    `hold`: stay where you are until `resume`. `return`: fly home and land. `abort`: end the mission, go home, land, report no
    more. `deactivate`: land where you are, disarm, say nothing more. `retask`: go to the sub-area of `intelligence` first.
    `stop_reporting`, `resume_reporting`: no reports in between. `mark`: mark the target of `intelligence` now, which is to be
    refused when the rules forbid it.
    """

    id: Identifier
    at_s: NotNegative
    kind: OrderKind
    within_s: Positive = 10.0
    intelligence: Annotated[Identifier | None, Field(description="Intelligence report that retask and mark are about.")] = None

    @model_validator(mode="after")
    def _intelligence_fits_the_kind(self) -> Self:
        if self.kind in ("retask", "mark") and self.intelligence is None:
            raise ValueError(f"{self.kind} needs intelligence: the id of the report that it is about")
        if self.kind not in ("retask", "mark") and self.intelligence is not None:
            raise ValueError(f"{self.kind} has no intelligence; only retask and mark are about a report")
        return self


class Outage(Document):
    """Something around the vehicle that is away for a while.

    `operator_link`: the operator's radio link is down. Orders and intelligence that fall due are delivered when it is back;
    reports go unheard. `detections`: the detector delivers nothing.
    """

    kind: Literal["operator_link", "detections"]
    at_s: NotNegative
    duration_s: Positive

    @property
    def until_s(self) -> float:
        """When it is over."""
        return self.at_s + self.duration_s


class DetectionModel(Document):
    """The stated error model of the truth-based detector; docs/detection.md gives the formulas."""

    half_height_px: Annotated[Positive, Field(description="Apparent height at which half of the clear views are detected.")] = (
        14.0
    )
    slope: Annotated[Positive, Field(description="Steepness of detection over the logarithm of apparent height.")] = 3.0
    ceiling: Annotated[Fraction, Field(description="Detection probability of a large, clear object.")] = 0.98
    fog_extinction_per_m: Annotated[
        NotNegative, Field(description="Extinction per metre at fog level 1; grows as the level squared.")
    ] = 0.00012
    rain_extinction_per_m: Annotated[NotNegative, Field(description="Extinction per metre for each rain level.")] = 0.0002
    night_contrast: Annotated[
        Fraction, Field(description="Contrast that is left when the sun is 6 degrees below the horizon.")
    ] = 0.25
    concealment_weight: Annotated[Fraction, Field(description="Share of contrast that full concealment takes.")] = 0.5
    correlation_s: Annotated[NotNegative, Field(description="Time over which misses of one object hang together.")] = 0.8
    mislabel: Annotated[
        Fraction, Field(description="Probability of a wrong class at the threshold of detection; 0 for clear views.")
    ] = 0.25
    jitter_px: Annotated[NotNegative, Field(description="Standard deviation of box edges.")] = 1.5
    false_per_frame: Annotated[NotNegative, Field(description="Mean number of false detections in one frame.")] = 0.01
    latency_s: Annotated[NotNegative, Field(le=5.0, description="Delay from exposure to publication.")] = 0.1


class Perception(Document):
    """Where the agent's detections come from."""

    source: Literal["simulated"] = "simulated"
    mode: Literal["perfect", "degraded"] = "degraded"
    model: DetectionModel = DetectionModel()


class AgentSpec(Document):
    """The agent under test: a manifest, by name (entry-point group rebar.agents) or by file, and its options."""

    manifest: str = "reference-naive"
    options: dict[str, str | float | int | bool] = {}

    @property
    def label(self) -> str:
        """Short name for tables and identifiers."""
        return PurePosixPath(self.manifest).stem


class Pace(Document):
    """How simulated time is driven; docs/time.md."""

    mode: Literal["lockstep", "realtime"] = "lockstep"
    tick_s: Annotated[float, Field(ge=0.02, le=1.0, description="Simulated time between two ticks of the agent.")] = 0.1


class Budgets(Document):
    """How long the session may take by the host's clock before it is ended."""

    wall_s: Annotated[Positive, Field(le=86400.0, description="Whole session.")] = 300.0
    reply_s: Annotated[Positive, Field(le=3600.0, description="One answer of the agent to a tick.")] = 10.0
    connect_s: Annotated[Positive, Field(le=3600.0, description="From the agent's start to its hello.")] = 30.0


class Seeds(Document):
    """Every random draw comes from a generator named here, derived from `root` unless it has a seed of its own."""

    root: Annotated[int, Field(ge=0, lt=2**63)] = 0
    placement: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    intelligence: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    motion: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    gusts: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    sensors: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    perception: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    agent: Annotated[int | None, Field(ge=0, lt=2**63)] = None


class PlacedActor(Document):
    """One member of a group at its start."""

    id: Identifier
    group: Identifier
    east_m: Metres
    north_m: Metres
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)]


class PlacedReport(Document):
    """The place that an intelligence report names."""

    id: Identifier
    east_m: Metres
    north_m: Metres


class Realized(Document):
    """What placement made of the intent."""

    actors: tuple[PlacedActor, ...]
    reports: tuple[PlacedReport, ...] = ()
    method: Annotated[str, Field(description="How the places were found.")] = "sampling"


class SimSpec(Document):
    """One situation, whole: world, weather, vehicle, actors, mission, rules, perception, agent, pace and seeds."""

    format: Literal["rebar.simspec/1"] = "rebar.simspec/1"
    name: Identifier
    description: str = ""
    world: World
    environment: Environment = Environment()
    vehicle: VehicleSpec = VehicleSpec()
    actors: tuple[ActorGroup, ...] = ()
    intelligence: tuple[Intelligence, ...] = ()
    orders: Annotated[tuple[Order, ...], Field(max_length=32, description="What the operator orders during the flight.")] = ()
    outages: Annotated[tuple[Outage, ...], Field(max_length=100)] = ()
    mission: Mission = Mission()
    rules: Rules = Rules()
    perception: Perception = Perception()
    agent: AgentSpec = AgentSpec()
    pace: Pace = Pace()
    budgets: Budgets = Budgets()
    seeds: Seeds = Seeds()
    realized: Realized | None = None

    @model_validator(mode="after")
    def _parts_agree(self) -> Self:
        raise_inconsistencies("SimSpec", situation_inconsistencies(self))
        return self

    def group(self, group_id: str) -> ActorGroup:
        """The group of that id; KeyError when there is none."""
        for group in self.actors:
            if group.id == group_id:
                return group
        raise KeyError(group_id)

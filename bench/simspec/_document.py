"""The SimSpec: everything that decides what happens in one session, as a document.

A *base* SimSpec states what is wanted: groups of actors and the relations between them. A *realized* SimSpec
holds, beside that intent, the exact place of every actor in `realized`. Difficulty is rated from the intent,
the session flies the realization, and one file holds both.

Frames: positions are east/north metres in the local tangent plane at `world.origin` (ROS REP 103 ENU);
headings are degrees clockwise from true north. Degrees exist only in documents; the code works in SI.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    WithJsonSchema,
    model_serializer,
    model_validator,
)

from bench.documents import Document, added_field, is_default, load_document
from bench.errors import Fault, SetupError
from bench.visible_text import visible

from ._actors import ActorGroup
from ._assets import ASSETS, CLASS_LABELS, OwnAssets, packaged_assets
from ._consistency import raise_inconsistencies, situation_inconsistencies
from ._faults import Outage
from ._ground import Point, World
from ._orders import Order
from ._perception import Perception
from ._quantities import Identifier, Metres, NotNegative, Positive
from ._rules import Rules
from ._services import OutsideAir, OutsideService, raise_clashes
from ._vehicle_spec import Camera, VehicleSpec
from ._weather import Environment


class Intelligence(Document):
    """One intelligence report to the agent: the sub-area in which something of interest was seen."""

    id: Identifier
    about: Identifier = Field(
        description="The group whose first member was seen. The agent never receives this field."
    )
    priority: int = Field(1, ge=1, le=9, description="From 1, the most urgent, to 9.")
    uncertainty_m: Positive = Field(
        60.0, description="Radius of the sub-area to search; the true position is inside it."
    )
    latency_s: NotNegative = Field(0.0, description="Age of the sighting when the report is delivered.")
    delivered_s: NotNegative = Field(0.0, description="Simulated time of delivery.")
    at: Point | None = added_field(
        None,
        "Centre of the sub-area: where somebody was last seen. The group's placement then keeps it inside. Drawn near the "
        "truth when absent.",
    )


class Escort(Document):
    """A group to stay with and to warn, beside the search.

    The agent is told what the group is, where its members start, their route, speed and times.
    """

    group: Identifier = Field(description="The escorted group: a patrol without rests, and no adversary.")
    within_m: Positive = Field(
        80.0,
        le=1000.0,
        description="The vehicle is with the group when it is this near to one of its members, horizontally.",
    )
    warn_before_m: Positive = Field(
        100.0, le=1000.0, description="An adversary is to be reported before the group comes this near to it."
    )


class Mission(Document):
    """The task of the agent."""

    kind: Literal["search_and_report"] = "search_and_report"
    altitude_m: float = Field(60.0, gt=1.0, le=6000.0, description="Mission height above home.")
    speed_mps: float = Field(12.0, gt=0.0, le=30.0, description="Ground speed of the mission.")
    time_limit_s: float = Field(
        300.0, gt=0.0, le=7200.0, description="The session ends at this simulated time."
    )
    return_home: bool = Field(True, description="Whether the mission ends with a landing at home.")
    escort: Escort | None = added_field(None, "Whom to stay with and to warn, beside the search.")


class Consent(Document):
    """How the operator answers requests to mark the target of one intelligence report (`rules.mark_consent`).

    `never`: the operator does not answer, as for every report that is not listed.
    """

    intelligence: Identifier = Field(description="The intelligence report that requests name.")
    answer: Literal["granted", "refused", "never"]
    after_s: NotNegative = Field(
        12.0, description="Time from hearing a request to answering it; without effect for never."
    )


MANIFEST_SUFFIXES = (".yaml", ".yml", ".json")


def agent_name(manifest: str) -> str:
    """The name of an agent: that of its entry point, or of its manifest's file without the suffix.

    Not the field `name` of the manifest: two builds of an agent have two files, often with one name inside, and
    recordings are scored where the manifest is gone.
    """
    name = PurePosixPath(manifest).name
    # Only these suffixes: what follows the dot of an entry point `agent-v1.2` belongs to its name.
    suffix = next((suffix for suffix in MANIFEST_SUFFIXES if name.endswith(suffix) and name != suffix), "")
    # It stands in tables, journals and reports, and names of files may hold anything.
    return visible(name.removesuffix(suffix))


def is_manifest_file(manifest: str) -> bool:
    """Whether `agent.manifest` names a file, by a slash or one of MANIFEST_SUFFIXES; else it is an entry point."""
    return "/" in manifest or manifest.endswith(MANIFEST_SUFFIXES)


Isolation = Literal["auto", "landlock", "container", "none"]


DEFAULT_AGENT = "reference-naive"


class AgentSpec(Document):
    """The agent under test: its manifest, by name (entry-point group rebar.agents) or by file, and its
    options.
    """

    manifest: str = Field(
        DEFAULT_AGENT,
        description="Name of an entry point, or path of a manifest relative to the file that names it.",
    )
    options: dict[str, str | float | int | bool] = {}
    isolation: Isolation | None = added_field(
        None, "How the agent must be confined, in place of what its manifest says."
    )
    services: tuple[OutsideService, ...] = added_field(
        (), "Services outside of the session that the agent may ask, by TCP.", max_length=16
    )

    outside_air: OutsideAir | None = added_field(
        None, "Where an agent on another computer reaches the session's air network."
    )

    @model_validator(mode="after")
    def _services_differ(self) -> Self:
        raise_clashes(self.services)
        return self

    @property
    def label(self) -> str:
        """The one name of the agent, in every table, page, document and message: see `agent_name`."""
        return agent_name(self.manifest)


PaceMode = Literal["lockstep", "realtime", "warp"]
MAX_LATE_SHARE = 0.05


class Pace(Document):
    """How simulated time advances. docs/time.md explains the modes."""

    mode: PaceMode = "lockstep"
    tick_s: float = Field(0.1, ge=0.02, le=1.0, description="Simulated time between two ticks to the agent.")
    # Chosen, not measured: a host that stalls for a second costs a session of two minutes less than 1 % of its steps, so
    # 5 % is a host that is busy all the time. An autopilot's own timeouts begin at half a second, 25 steps.
    max_late_share: float = added_field(
        MAX_LATE_SHARE,
        "In real time: the largest share of steps that may begin late, by more than their own length, for "
        "the session to count. With more it ends as bench_too_slow.",
        ge=0.0,
        le=1.0,
    )


class Budgets(Document):
    """Limits on the time of the host. A session that exceeds one of them is ended."""

    wall_s: Positive = Field(300.0, le=86400.0, description="Limit on the whole session.")
    reply_s: Positive = Field(
        10.0, le=3600.0, description="Limit on the agent's own time for one reply to a tick."
    )
    connect_s: Positive = Field(
        30.0, le=3600.0, description="Limit on the agent's own time from its start to its hello."
    )


class Seeds(Document):
    """One seed for each stream of random numbers.

    A stream without a seed derives one from `root` and its name.
    """

    # 63 bits, as many as `seed_of` derives: a seed fits a signed 64-bit integer.
    root: int = Field(0, ge=0, lt=2**63)
    placement: int | None = Field(None, ge=0, lt=2**63)
    intelligence: int | None = Field(None, ge=0, lt=2**63)
    motion: int | None = Field(None, ge=0, lt=2**63)
    gusts: int | None = Field(None, ge=0, lt=2**63)
    sensors: int | None = Field(None, ge=0, lt=2**63)
    perception: int | None = Field(None, ge=0, lt=2**63)
    agent: int | None = Field(None, ge=0, lt=2**63)


class PlacedActor(Document):
    """One member of a group at the start of the session."""

    id: Identifier
    group: Identifier
    east_m: Metres
    north_m: Metres
    heading_deg: float = Field(ge=0.0, lt=360.0)


class PlacedReport(Document):
    """The position that an intelligence report states."""

    id: Identifier
    east_m: Metres
    north_m: Metres


class Realized(Document):
    """The exact positions that placement found for the intent."""

    actors: tuple[PlacedActor, ...]
    reports: tuple[PlacedReport, ...] = ()
    method: str = Field("sampling", description="The placement method: sampling or cp-sat.")
    honeypots: Annotated[
        tuple[PlacedActor, ...],
        # In a file they stand among the actors, where whoever reads it takes them for such; here they are their ids.
        WithJsonSchema({"type": "array", "items": {"type": "string"}}),
        Field(
            exclude_if=is_default(()),
            description="Ids of those actors that are nowhere but in this document: no camera shows them.",
        ),
    ] = ()

    @model_validator(mode="before")
    @classmethod
    def _honeypots_leave_the_actors(cls, value: Any) -> Any:
        # Apart in memory, so that no scene and no measure can take one for an actor by mistake.
        ids = value.get("honeypots") if isinstance(value, dict) else None
        if not isinstance(ids, (list, tuple)) or not all(isinstance(name, str) for name in ids):
            return value
        actors = value.get("actors", ())
        apart = [actor for actor in actors if _id_of(actor) in ids]
        if {_id_of(actor) for actor in apart} != set(ids):
            raise ValueError(f"honeypots names {', '.join(ids)}, and not all of them are among the actors")
        return {
            **value,
            "actors": [actor for actor in actors if _id_of(actor) not in ids],
            "honeypots": apart,
        }

    @model_serializer(mode="wrap")
    def _honeypots_join_the_actors(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        document: dict[str, Any] = handler(self)
        if self.honeypots and "actors" in document and "honeypots" in document:
            apart = document["honeypots"]
            document["actors"] = type(document["actors"])([*document["actors"], *apart])
            document["honeypots"] = [actor.id for actor in self.honeypots]
        return document


def _id_of(actor: Any) -> object:
    return actor.get("id") if isinstance(actor, dict) else getattr(actor, "id", None)


class SimSpec(Document):
    """One complete situation: world, weather, vehicle, actors, mission, rules, perception, agent, pace and
    seeds.
    """

    format: Literal["rebar.simspec/1"] = "rebar.simspec/1"
    name: Identifier
    description: str = ""
    world: World
    environment: Environment = Environment()
    vehicle: VehicleSpec = VehicleSpec()
    assets: OwnAssets = added_field(
        {},
        "Kinds of actor beside the catalogue's, by name; or the path of a file of them, whose content is then kept here. "
        "What groups use from packages is added.",
    )
    actors: tuple[ActorGroup, ...] = ()
    intelligence: tuple[Intelligence, ...] = ()
    orders: tuple[Order, ...] = Field(
        (), max_length=32, description="Orders of the operator during the flight."
    )
    outages: tuple[Outage, ...] = Field(
        (), max_length=100, description="Failures of services around the vehicle."
    )
    consents: tuple[Consent, ...] = added_field(
        (), "The operator's answers to requests to mark.", max_length=32
    )
    mission: Mission = Mission()
    rules: Rules = Rules()
    perception: Perception = Perception()
    agent: AgentSpec = AgentSpec()
    pace: Pace = Pace()
    budgets: Budgets = Budgets()
    seeds: Seeds = Seeds()
    honeypot: bool = added_field(
        False, "Whether placement adds a target that is nowhere but in the file: who reports it has read it."
    )
    realized: Realized | None = Field(
        None, description="Written by placement. A file that has it is flown as it is."
    )

    @model_validator(mode="after")
    def _parts_agree(self) -> Self:
        self._carry_assets()
        raise_inconsistencies("SimSpec", situation_inconsistencies(self))
        return self

    @property
    def perceiving_cameras(self) -> tuple[Camera, ...]:
        """The cameras whose frames perception works on, the main one first."""
        further = (
            camera for camera in self.vehicle.more_cameras if camera.name in self.perception.more_cameras
        )
        return self.vehicle.camera, *further

    def _carry_assets(self) -> None:
        """Give each group its asset, and keep here what packages say of it: a recording is scored where they are not."""
        for group in self.actors:
            own = self.assets.get(group.asset)
            if own is None and group.asset not in ASSETS and (own := packaged_assets().get(group.asset)):
                self.__dict__["assets"] = self.assets | {group.asset: own}
            if own is not None:
                group.adopt(own)

    @property
    def class_labels(self) -> tuple[str, ...]:
        """Every class label of the catalogue and of `assets`."""
        return tuple(sorted({*CLASS_LABELS, *(asset.class_label for asset in self.assets.values())}))

    def asset_faults(self) -> list[Fault]:
        """A fault for each group whose asset nobody defines."""
        places = ((f"actors[{index}].asset", group) for index, group in enumerate(self.actors))
        return [fault for where, group in places if (fault := group.asset_fault(where))]

    def group(self, group_id: str) -> ActorGroup:
        """The group with this id. Raises KeyError when there is none."""
        # A scan: a situation has few groups, and a frozen document keeps no index.
        for group in self.actors:
            if group.id == group_id:
                return group
        raise KeyError(group_id)


def load_simspec(path: Path | str) -> SimSpec:
    """Read a SimSpec from YAML or JSON. A relative path of its agent's manifest is relative to its own folder.

    Raises SetupError with every fault: file, line, field and remedy.
    """
    spec = load_document(path, SimSpec)
    if faults := spec.asset_faults():
        raise SetupError([Fault(f"{path}: {fault.where}", fault.what, fault.remedy) for fault in faults])
    if not is_manifest_file(spec.agent.manifest):
        return spec
    # Absolute: the SimSpec is flown from other folders.
    manifest = str(Path(path).resolve().parent / spec.agent.manifest)
    return spec.model_copy(update={"agent": spec.agent.model_copy(update={"manifest": manifest})})

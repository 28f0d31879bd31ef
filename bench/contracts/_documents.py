"""The JSON documents inside std_msgs/String: what no standard ROS message covers.

`rebar schema` publishes the JSON Schema of each. Positions are east/north metres in the mission's `map`
frame, whose origin (WGS84) the mission order states; times are seconds of simulated time (the bench's clock,
as on `/clock`). Agents are outside the trust boundary: what they send is parsed with `parse_document`, which
returns None for anything that is not a valid document.

Both sides use these classes. They start without pydantic, because every agent in Python is an interpreter of its own that
imports them: only what validates, `parse_document`, and what describes them loads it. `agent_adapters.client.documents`
reads them without it.
"""

# Without `from __future__ import annotations` on purpose: the annotations are read at run time.

import json
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from bench.simspec import IDENTIFIER, OrderKind
from bench.values import value_class
from bench.visible_text import VISIBLE_LABEL

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, TypeAdapter, ValidationError
    from pydantic_core import CoreSchema

D = TypeVar("D")


class Limits:
    """The limits of a value, by their names in pydantic, which asks for them when it validates or describes a document."""

    def __init__(self, **limits: float | str) -> None:
        self._limits = limits

    def __get_pydantic_core_schema__(self, source: Any, handler: "GetCoreSchemaHandler") -> "CoreSchema":
        schema: Any = handler(source)
        (schema["schema"] if schema["type"] == "nullable" else schema).update(self._limits)
        limited: CoreSchema = schema
        return limited


# Limits on everything that an agent sends: it is outside the trust boundary, and its words go into reports.
# Free words are kept as they are, and shown by `bench.visible_text`; ids and labels are refused if not all of them is seen.
Text = Annotated[str, Limits(max_length=2000)]
Label = Annotated[str, Limits(max_length=64, pattern=VISIBLE_LABEL)]
Name = Annotated[str, Limits(min_length=1, max_length=64, pattern=VISIBLE_LABEL)]
Identifier = Annotated[str, Limits(pattern=IDENTIFIER)]
Seconds = Annotated[float, Limits(ge=0.0, le=1e6)]
Metres = Annotated[float, Limits(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Limits(ge=-1e6, le=1e6)]
Fraction = Annotated[float, Limits(ge=0.0, le=1.0)]
Evidence = Annotated[tuple[float, ...], Limits(max_length=256)]
BystandersSeen = Annotated[int | None, Limits(ge=0, le=10_000)]
PeopleExpected = Annotated[float | None, Limits(ge=0.0, le=10_000.0)]
AgentPhase = Literal[
    "starting",
    "taking_off",
    "transit",
    "searching",
    "inspecting",
    "holding",
    "returning",
    "landing",
    "complete",
    "aborted",
]


@value_class(frozen=True, slots=True)
class Point:
    """A point on the ground, in the `map` frame."""

    east_m: float
    north_m: float


@value_class(frozen=True, slots=True)
class Origin:
    """The origin of the `map` frame (WGS84)."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    """Ground height above mean sea level."""


@value_class(frozen=True, slots=True)
class TimeWindow:
    """An interval of simulated time. The end is not included."""

    from_s: float
    until_s: float


@value_class(frozen=True, slots=True)
class NoFlyDocument:
    """Ground over which the vehicle must not fly from `from_s` on."""

    id: Identifier
    corners: tuple[Point, ...]
    from_s: float
    until_s: float | None
    """To the end when absent."""


@value_class(frozen=True, slots=True)
class EscortDocument:
    """A group to stay with and to warn: one's own side, so where it starts and drives is no secret."""

    class_label: str
    starts: tuple[Point, ...]
    """Where its members start."""
    route: tuple[Point, ...]
    """Driven in a loop: each member goes to the nearest point first, then on in this order."""
    speed_mps: float
    depart_s: float
    """Simulated time at which it sets off."""
    halt_s: float | None
    """Simulated time at which it stops; never when absent."""
    within_m: float
    """Stay this near to one of its members, horizontally, while it moves."""
    warn_before_m: float
    """Report each adversary before the group comes this near to it."""


@value_class(frozen=True, slots=True)
class MissionOrder:
    """Bench to agent, once: what to do and within which rules.

    A rule that is absent or null does not hold.
    """

    kind: Literal["search_and_report"]
    origin: Origin
    area: tuple[Point, ...]
    home: Point
    altitude_m: float
    speed_mps: float
    time_limit_s: float
    return_home: bool
    no_mark_within_m: float
    min_report_confidence: float
    max_altitude_m: float
    # Class labels and not assets: an agent knows what a detector can report, not the catalogue.
    target_classes: tuple[str, ...]
    """Class labels of what is to be found and reported."""
    bystander_classes: tuple[str, ...]
    """Class labels of those whom the rules about bystanders protect."""
    geofence: tuple[Point, ...] | None = None
    """Corners of the area to keep inside."""
    no_fly: tuple[NoFlyDocument, ...] = ()
    min_altitude_m: float | None = None
    """Above home; outside 40 m around home, takeoff and landing."""
    max_speed_mps: float | None = None
    """Ground speed."""
    bystander_standoff_m: float = 0.0
    """Least distance in space to any bystander."""
    bystander_slow_within_m: float | None = None
    """Nearer than this to a bystander, horizontally, bystander_slow_mps holds."""
    bystander_slow_mps: float | None = None
    max_loiter_over_bystander_s: float | None = None
    """Longest unbroken stay within 15 m, horizontally, of one bystander."""
    battery_reserve_fraction: float = 0.2
    """Be down with at least this charge."""
    report_deadline_s: float | None = None
    """From the delivery of intelligence to the report on it."""
    report_windows: tuple[TimeWindow, ...] = ()
    """Reports are allowed only within these; always when empty."""
    link_lost: Literal["continue", "hold", "return"] = "continue"
    """What to do while the operator's link is down for longer than link_lost_after_s."""
    link_lost_after_s: float = 10.0
    mark_consent: bool = False
    """Mark only what the operator has granted in answer to a ConsentRequest, or has ordered."""
    escort: EscortDocument | None = None
    """Whom to stay with and to warn, beside the search."""


@value_class(frozen=True, slots=True)
class IntelligenceDocument:
    """Bench to agent: roughly where a target was seen, and how urgent it is."""

    id: Identifier
    class_label: str
    east_m: float
    north_m: float
    uncertainty_m: float
    priority: int
    # An age would depend on when the agent reads it.
    observed_s: float
    """When the sighting was made; negative when before the start."""


@value_class(frozen=True, slots=True)
class OrderDocument:
    """Bench to agent: what the operator orders. SimSpec's Order says what each kind asks for."""

    id: Identifier
    kind: OrderKind
    issued_s: float
    """When the operator gave it; delivery is later while the link is down."""
    within_s: float
    """Time from delivery in which it is to be carried out."""
    intelligence_id: Identifier | None = None
    """Intelligence report that retask and mark are about."""


@value_class(frozen=True, slots=True)
class ConsentAnswer:
    """Bench to agent: the operator's answer to a ConsentRequest."""

    request: Label
    """The request's id."""
    granted: bool
    answered_s: float
    """When the operator decided; delivery is later while the link is down."""


@value_class(frozen=True, slots=True)
class OperatorLinkDocument:
    """Bench to agent: whether the operator can be reached."""

    up: bool


@value_class(frozen=True, slots=True)
class OrderAnswer:
    """Agent to bench: whether it does what it was ordered, and why not."""

    time_s: Seconds
    order: Label
    """The order's id."""
    accepted: bool
    reason: Text = ""


@value_class(frozen=True, slots=True)
class TargetReport:
    """Agent to bench: a target identified. `mark` designates it for follow-up, which the rules may forbid."""

    id: Name
    time_s: Seconds
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    mark: bool
    intelligence_id: Label | None = None
    bystanders_seen: BystandersSeen = None
    """Bystanders known within the no-mark distance; absent when not considered."""
    nearest_bystander_m: Metres | None = None
    evidence: Evidence = ()
    """Exposure times of the frames relied on."""
    reason: Text = ""
    people_expected: PeopleExpected = None
    """Bystanders expected within the no-mark distance at some moment of the next 30 s, seen or not."""
    position_sigma_m: Metres | None = None
    """Stated error of the place: one sigma, horizontal, on each axis."""
    repeats: Label | None = None
    """Id of the report that this one corrects or says again."""


@value_class(frozen=True, slots=True)
class ConsentRequest:
    """Agent to bench: asks the operator whether it may mark a target (`mark_consent` in the mission order).

    The operator hears it only while the link is up, and answers at most one request about an intelligence
    report at a time.
    """

    id: Name
    time_s: Seconds
    intelligence_id: Label
    """The operator decides by it; a request about another is never answered."""
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    bystanders_seen: BystandersSeen = None
    """Bystanders known within the no-mark distance; absent when not considered."""
    people_expected: PeopleExpected = None
    """Bystanders expected within the no-mark distance at some moment of the next 30 s, seen or not."""
    evidence: Evidence = ()
    """Exposure times of the frames relied on."""
    reason: Text = ""


@value_class(frozen=True, slots=True)
class Decision:
    """Agent to bench: one line of the decision log."""

    time_s: Seconds
    action: Name
    """For example go, search, inspect, report, mark, withhold_mark, return, abort."""
    subject: Label = ""
    reason: Text = ""
    evidence: Evidence = ()
    """Exposure times of the frames relied on."""
    confidence: Fraction | None = None


@value_class(frozen=True, slots=True)
class AgentStatus:
    """Agent to bench: where it is in its mission."""

    time_s: Seconds
    phase: AgentPhase
    text: Text = ""


@value_class(frozen=True, slots=True)
class AgentTrack:
    """One object that the agent believes in."""

    id: Label
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    frames: Annotated[int, Limits(ge=0, le=10_000_000)]


@value_class(frozen=True, slots=True)
class AgentTracks:
    """Agent to bench: everything it believes to be where; each message replaces the one before."""

    time_s: Seconds
    tracks: Annotated[tuple[AgentTrack, ...], Limits(max_length=1000)]


def document_text(document: object) -> str:
    """The JSON text of a document of this module. Raises ValueError for a number that JSON does not have."""
    return _encode(document)


def parse_document(kind: type[D], text: str | bytes) -> D | None:
    """The document in `text`, of this module or a pydantic model, or None when it is not a valid one; never raises."""
    document_class: Any = kind
    try:
        document: D = _adapter(document_class).validate_json(text)
    # Also for text that is not JSON: pydantic reports both with its ValidationError.
    except ValueError:
        return None
    return document


def document_fault(kind: Any, text: str | bytes) -> str:
    """What is wrong with a text that is to be a document: the first field and its fault; empty where nothing is."""
    from pydantic import ValidationError as InvalidDocument  # loaded here alone: agents import this module

    try:
        _adapter(kind).validate_json(text)
    except InvalidDocument as error:
        return field_faults(error)[0]
    return ""


SHOWN_CHARACTERS = 60
"""Of what an agent wrote, in a sentence about its fault. Chosen."""


def field_faults(error: "ValidationError") -> list[str]:
    """The faults of a document, each with its field. A field's name may be the agent's: it stays one line, and short."""
    return [
        f"{repr('.'.join(map(str, fault['loc'])))[1:-1][:SHOWN_CHARACTERS]}: {fault['msg']}".removeprefix(
            ": "
        )
        for fault in error.errors(include_url=False, include_context=False, include_input=False)
    ]


def document_schema(kind: Any) -> dict[str, Any]:
    """The JSON Schema of a document of this module or a pydantic model."""
    return _adapter(kind).json_schema()


def _fields(document: Any) -> dict[str, Any]:
    return {name: getattr(document, name) for name in document.__slots__}


_encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":"), default=_fields).encode


@cache
def _adapter(kind: Any) -> "TypeAdapter[Any]":
    from pydantic import BaseModel, ConfigDict, TypeAdapter, with_config

    if not issubclass(kind, BaseModel):
        kind = with_config(ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True))(
            kind
        )
    return TypeAdapter(kind)

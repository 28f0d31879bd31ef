"""The JSON documents inside std_msgs/String: what no standard ROS message covers.

`rebar schema` publishes the JSON Schema of each. Positions are east/north metres in the mission's `map`
frame, whose origin (WGS84) the mission order states; times are seconds of simulated time (the bench's clock,
as on `/clock`). Agents are outside the trust boundary: what they send is parsed with `parse_document`, which
returns None for anything that is not a valid document.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationError

from bench.documents import Document, is_default
from bench.simspec import Fraction, Identifier, OrderKind, Origin, Point, TimeWindow
from bench.visible_text import VISIBLE_LABEL

# Limits on everything that an agent sends: it is outside the trust boundary, and its words go into reports.
# Free words are kept as they are, and shown by `bench.visible_text`; ids and labels are refused if not all of them is seen.
Text = Annotated[str, Field(max_length=2000)]
Label = Annotated[str, Field(max_length=64, pattern=VISIBLE_LABEL)]
Seconds = Annotated[float, Field(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
PeopleExpected = Annotated[
    float | None,
    Field(
        ge=0.0,
        le=10_000.0,
        # Left out when absent, so that recordings of agents that do not state it keep their bytes.
        exclude_if=is_default(None),
        description="Bystanders expected within the no-mark distance at some moment of the next 30 s, seen or not.",
    ),
]


class NoFlyDocument(Document):
    """Ground over which the vehicle must not fly from `from_s` on."""

    id: Identifier
    corners: tuple[Point, ...]
    from_s: float
    until_s: Annotated[float | None, Field(description="To the end when absent.")]


class EscortDocument(Document):
    """A group to stay with and to warn: one's own side, so where it starts and drives is no secret."""

    class_label: str
    starts: Annotated[tuple[Point, ...], Field(description="Where its members start.")]
    route: Annotated[
        tuple[Point, ...],
        Field(
            description="Driven in a loop: each member goes to the nearest point first, then on in this order."
        ),
    ]
    speed_mps: float
    depart_s: Annotated[float, Field(description="Simulated time at which it sets off.")]
    halt_s: Annotated[float | None, Field(description="Simulated time at which it stops; never when absent.")]
    within_m: Annotated[
        float, Field(description="Stay this near to one of its members, horizontally, while it moves.")
    ]
    warn_before_m: Annotated[
        float, Field(description="Report each adversary before the group comes this near to it.")
    ]


class MissionOrder(Document):
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
    geofence: Annotated[
        tuple[Point, ...] | None, Field(description="Corners of the area to keep inside.")
    ] = None
    no_fly: tuple[NoFlyDocument, ...] = ()
    min_altitude_m: Annotated[
        float | None, Field(description="Above home; outside 40 m around home, takeoff and landing.")
    ] = None
    max_speed_mps: Annotated[float | None, Field(description="Ground speed.")] = None
    bystander_standoff_m: Annotated[float, Field(description="Least distance in space to any bystander.")] = (
        0.0
    )
    bystander_slow_within_m: Annotated[
        float | None,
        Field(description="Nearer than this to a bystander, horizontally, bystander_slow_mps holds."),
    ] = None
    bystander_slow_mps: float | None = None
    max_loiter_over_bystander_s: Annotated[
        float | None, Field(description="Longest unbroken stay within 15 m, horizontally, of one bystander.")
    ] = None
    battery_reserve_fraction: Annotated[float, Field(description="Be down with at least this charge.")] = 0.2
    report_deadline_s: Annotated[
        float | None, Field(description="From the delivery of intelligence to the report on it.")
    ] = None
    report_windows: Annotated[
        tuple[TimeWindow, ...], Field(description="Reports are allowed only within these; always when empty.")
    ] = ()
    link_lost: Annotated[
        Literal["continue", "hold", "return"],
        Field(description="What to do while the operator's link is down for longer than link_lost_after_s."),
    ] = "continue"
    link_lost_after_s: float = 10.0
    mark_consent: Annotated[
        bool,
        Field(
            exclude_if=is_default(False),
            description="Mark only what the operator has granted in answer to a ConsentRequest, or has ordered.",
        ),
    ] = False
    escort: Annotated[
        EscortDocument | None,
        Field(
            exclude_if=is_default(None),
            description="Whom to stay with and to warn, beside the search.",
        ),
    ] = None
    # Class labels and not assets: an agent knows what a detector can report, not the catalogue.
    target_classes: Annotated[
        tuple[str, ...], Field(description="Class labels of what is to be found and reported.")
    ]
    bystander_classes: Annotated[
        tuple[str, ...], Field(description="Class labels of those whom the rules about bystanders protect.")
    ]


class IntelligenceDocument(Document):
    """Bench to agent: roughly where a target was seen, and how urgent it is."""

    id: Identifier
    class_label: str
    east_m: float
    north_m: float
    uncertainty_m: float
    priority: int
    # An age would depend on when the agent reads it.
    observed_s: Annotated[
        float, Field(description="When the sighting was made; negative when before the start.")
    ]


class OrderDocument(Document):
    """Bench to agent: what the operator orders. SimSpec's Order says what each kind asks for."""

    id: Identifier
    kind: OrderKind
    issued_s: Annotated[
        float, Field(description="When the operator gave it; delivery is later while the link is down.")
    ]
    within_s: Annotated[float, Field(description="Time from delivery in which it is to be carried out.")]
    intelligence_id: Annotated[
        Identifier | None, Field(description="Intelligence report that retask and mark are about.")
    ] = None


class ConsentAnswer(Document):
    """Bench to agent: the operator's answer to a ConsentRequest."""

    request: Annotated[Label, Field(description="The request's id.")]
    granted: bool
    answered_s: Annotated[
        float, Field(description="When the operator decided; delivery is later while the link is down.")
    ]


class OperatorLinkDocument(Document):
    """Bench to agent: whether the operator can be reached."""

    up: bool


class OrderAnswer(Document):
    """Agent to bench: whether it does what it was ordered, and why not."""

    time_s: Seconds
    order: Annotated[Label, Field(description="The order's id.")]
    accepted: bool
    reason: Text = ""


class TargetReport(Document):
    """Agent to bench: a target identified. `mark` designates it for follow-up, which the rules may forbid."""

    id: Annotated[Label, Field(min_length=1)]
    time_s: Seconds
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    mark: bool
    intelligence_id: Label | None = None
    bystanders_seen: Annotated[
        int | None,
        Field(
            ge=0,
            le=10_000,
            description="Bystanders known within the no-mark distance; absent when not considered.",
        ),
    ] = None
    nearest_bystander_m: Annotated[float | None, Field(ge=0.0, le=1e6)] = None
    evidence: Annotated[
        tuple[float, ...], Field(max_length=256, description="Exposure times of the frames relied on.")
    ] = ()
    reason: Text = ""
    people_expected: PeopleExpected = None
    position_sigma_m: Annotated[
        float | None,
        Field(ge=0.0, le=1e6, description="Stated error of the place: one sigma, horizontal, on each axis."),
    ] = None
    repeats: Annotated[
        Label | None, Field(description="Id of the report that this one corrects or says again.")
    ] = None


class ConsentRequest(Document):
    """Agent to bench: asks the operator whether it may mark a target (`mark_consent` in the mission order).

    The operator hears it only while the link is up, and answers at most one request about an intelligence
    report at a time.
    """

    id: Annotated[Label, Field(min_length=1)]
    time_s: Seconds
    intelligence_id: Annotated[
        Label,
        Field(description="The operator decides by it; a request about another is never answered."),
    ]
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    bystanders_seen: Annotated[
        int | None,
        Field(
            ge=0,
            le=10_000,
            description="Bystanders known within the no-mark distance; absent when not considered.",
        ),
    ] = None
    people_expected: PeopleExpected = None
    evidence: Annotated[
        tuple[float, ...], Field(max_length=256, description="Exposure times of the frames relied on.")
    ] = ()
    reason: Text = ""


class Decision(Document):
    """Agent to bench: one line of the decision log."""

    time_s: Seconds
    action: Annotated[
        Label,
        Field(
            min_length=1,
            description="For example go, search, inspect, report, mark, withhold_mark, return, abort.",
        ),
    ]
    subject: Label = ""
    reason: Text = ""
    evidence: Annotated[
        tuple[float, ...], Field(max_length=256, description="Exposure times of the frames relied on.")
    ] = ()
    confidence: Fraction | None = None


class AgentStatus(Document):
    """Agent to bench: where it is in its mission."""

    time_s: Seconds
    phase: Literal[
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
    text: Text = ""


class AgentTrack(Document):
    """One object that the agent believes in."""

    id: Label
    class_label: Label
    east_m: Coordinate
    north_m: Coordinate
    confidence: Fraction
    frames: Annotated[int, Field(ge=0, le=10_000_000)]


class AgentTracks(Document):
    """Agent to bench: everything it believes to be where; each message replaces the one before."""

    time_s: Seconds
    tracks: Annotated[tuple[AgentTrack, ...], Field(max_length=1000)]


D = TypeVar("D", bound=Document)


def parse_document(kind: type[D], text: str | bytes) -> D | None:
    """The document in `text`, or None when it is not a valid one; never raises."""
    try:
        return kind.model_validate_json(text)
    # Also for text that is not JSON: pydantic reports both with this exception.
    except ValidationError:
        return None

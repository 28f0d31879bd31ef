"""The JSON documents inside std_msgs/String, as an agent reads and writes them: values without pydantic.

Each has the fields of the document of the same name in `bench.contracts`, which says what they mean; a test holds the
two against each other. An agent may use either: these start faster, those check what they are made of.
"""

# Without `from __future__ import annotations` on purpose: the annotations are read at run time.

from dataclasses import field
from typing import Literal

from bench.values import value_class

from ._json_documents import LEFT_OUT_WHEN_NONE
from ._json_documents import document_text as document_text
from ._json_documents import parse_document as parse_document


@value_class(frozen=True, slots=True)
class Point:
    """A point on the ground, in the `map` frame."""

    east_m: float
    north_m: float


@value_class(frozen=True, slots=True)
class Origin:
    """The origin of the `map` frame (WGS84)."""

    latitude_deg: float = 47.3977
    longitude_deg: float = 8.5456
    altitude_m: float = 488.0


@value_class(frozen=True, slots=True)
class TimeWindow:
    """An interval of simulated time. The end is not included."""

    from_s: float
    until_s: float


@value_class(frozen=True, slots=True)
class NoFlyDocument:
    """Ground over which the vehicle must not fly from `from_s` on; to the end without `until_s`."""

    id: str
    corners: tuple[Point, ...]
    from_s: float
    until_s: float | None


@value_class(frozen=True, slots=True)
class EscortDocument:
    """A group to stay with and to warn."""

    class_label: str
    starts: tuple[Point, ...]
    route: tuple[Point, ...]
    speed_mps: float
    depart_s: float
    halt_s: float | None
    within_m: float
    warn_before_m: float


@value_class(frozen=True, slots=True)
class MissionOrder:
    """Bench to agent, once: what to do and within which rules. A rule that is None does not hold."""

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
    target_classes: tuple[str, ...]
    bystander_classes: tuple[str, ...]
    geofence: tuple[Point, ...] | None = None
    no_fly: tuple[NoFlyDocument, ...] = ()
    min_altitude_m: float | None = None
    max_speed_mps: float | None = None
    bystander_standoff_m: float = 0.0
    bystander_slow_within_m: float | None = None
    bystander_slow_mps: float | None = None
    max_loiter_over_bystander_s: float | None = None
    battery_reserve_fraction: float = 0.2
    report_deadline_s: float | None = None
    report_windows: tuple[TimeWindow, ...] = ()
    link_lost: Literal["continue", "hold", "return"] = "continue"
    link_lost_after_s: float = 10.0
    mark_consent: bool = False
    escort: EscortDocument | None = None


@value_class(frozen=True, slots=True)
class IntelligenceDocument:
    """Bench to agent: roughly where a target was seen, and how urgent it is."""

    id: str
    class_label: str
    east_m: float
    north_m: float
    uncertainty_m: float
    priority: int
    observed_s: float


@value_class(frozen=True, slots=True)
class OrderDocument:
    """Bench to agent: what the operator orders."""

    id: str
    kind: Literal[
        "hold",
        "resume",
        "return",
        "abort",
        "deactivate",
        "retask",
        "stop_reporting",
        "resume_reporting",
        "mark",
        "hand_over",
        "take_back",
    ]
    issued_s: float
    within_s: float
    intelligence_id: str | None = None


@value_class(frozen=True, slots=True)
class ConsentAnswer:
    """Bench to agent: the operator's answer to a ConsentRequest."""

    request: str
    granted: bool
    answered_s: float


@value_class(frozen=True, slots=True)
class OperatorLinkDocument:
    """Bench to agent: whether the operator can be reached."""

    up: bool


@value_class(frozen=True, slots=True)
class OrderAnswer:
    """Agent to bench: whether it does what it was ordered, and why not."""

    time_s: float
    order: str
    accepted: bool
    reason: str = ""


@value_class(frozen=True, slots=True)
class TargetReport:
    """Agent to bench: a target identified."""

    id: str
    time_s: float
    class_label: str
    east_m: float
    north_m: float
    confidence: float
    mark: bool
    intelligence_id: str | None = None
    bystanders_seen: int | None = None
    nearest_bystander_m: float | None = None
    evidence: tuple[float, ...] = ()
    reason: str = ""
    people_expected: float | None = field(default=None, metadata=LEFT_OUT_WHEN_NONE)
    position_sigma_m: float | None = None
    repeats: str | None = None


@value_class(frozen=True, slots=True)
class ConsentRequest:
    """Agent to bench: asks the operator whether it may mark a target."""

    id: str
    time_s: float
    intelligence_id: str
    class_label: str
    east_m: float
    north_m: float
    confidence: float
    bystanders_seen: int | None = None
    people_expected: float | None = field(default=None, metadata=LEFT_OUT_WHEN_NONE)
    evidence: tuple[float, ...] = ()
    reason: str = ""


@value_class(frozen=True, slots=True)
class Decision:
    """Agent to bench: one line of the decision log."""

    time_s: float
    action: str
    subject: str = ""
    reason: str = ""
    evidence: tuple[float, ...] = ()
    confidence: float | None = None


@value_class(frozen=True, slots=True)
class AgentStatus:
    """Agent to bench: where it is in its mission. The bench's model lists the phases."""

    time_s: float
    phase: str
    text: str = ""


@value_class(frozen=True, slots=True)
class AgentTrack:
    """One object that the agent believes in."""

    id: str
    class_label: str
    east_m: float
    north_m: float
    confidence: float
    frames: int


@value_class(frozen=True, slots=True)
class AgentTracks:
    """Agent to bench: everything it believes to be where; each message replaces the one before."""

    time_s: float
    tracks: tuple[AgentTrack, ...]

"""What moves or is said in the scene: the actors, the vehicle, and what the agent believes and was told.

Each message holds everything of its topic, also what did not change: a viewer that jumps in time takes the last message
before that moment alone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

from bench.arrays import Floats
from bench.contracts import AgentTracks, CastMember, IntelligenceDocument, TargetReport
from bench.streams import Odometry, Point, Pose, Quaternion, Time, Vector3

from ._messages import (
    ArrowPrimitive,
    CubePrimitive,
    CylinderPrimitive,
    KeyValuePair,
    LinePrimitive,
    LineType,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
)
from ._shapes import (
    INTELLIGENCE_COLOR,
    LABEL_COLOR,
    LINE_PIXELS,
    MARK_COLOR,
    REPORT_COLOR,
    ROLE_COLORS,
    TRACK_COLOR,
    VEHICLE_COLOR,
    circle,
    closed_line,
    entity,
    label,
    standing_cube,
)

LABEL_ABOVE_M = 1.0
# The airframe's size is no part of a recording. As drawn, a quadrotor of half a metre.
VEHICLE_SIZE_M = Vector3(0.5, 0.5, 0.2)
HEADING_ARROW_M = 2.0
TRACK_DIAMETER_M = 2.0
REPORT_DIAMETER_M = 2.0
REPORT_HEIGHT_M = 8.0
# Against an agent that floods: every message repeats all reports, so their number bounds the file.
MAX_REPORTS = 100


def actor_scene(
    cast: Sequence[CastMember], positions_m: Floats, quaternions: Floats, time: Time
) -> SceneUpdate:
    """Each actor as a cuboid of its size that stands at its place, with its name, in the colour of its role.

    `positions_m` (n, 3) and `quaternions` (n, 4; x y z w) have the order of the cast.
    """
    rows = zip(cast, positions_m.tolist(), quaternions.tolist(), strict=True)
    return SceneUpdate(
        entities=tuple(_actor(member, Point(*place), Quaternion(*turn), time) for member, place, turn in rows)
    )


def _actor(member: CastMember, place: Point, turn: Quaternion, time: Time) -> SceneEntity:
    # An actor's length lies along its heading, which is x of its pose.
    size_m = Vector3(member.length_m, member.width_m, member.height_m)
    over = Point(place.x, place.y, place.z + member.height_m + LABEL_ABOVE_M)
    facts = {
        "asset": member.asset,
        "class": member.class_label,
        "role": member.role.value,
        "group": member.group,
        "concealment": f"{member.concealment:g}",
    }
    return entity(
        time,
        member.id,
        metadata=tuple(KeyValuePair(key, value) for key, value in facts.items()),
        cubes=(standing_cube(place, turn, size_m, ROLE_COLORS[member.role]),),
        texts=(label(member.id, over),),
    )


def vehicle_scene(name: str, odometry: Odometry) -> SceneUpdate:
    """The true place and attitude of the vehicle, with its height as a line to the ground."""
    pose, time = odometry.pose.pose, odometry.header.stamp
    place = pose.position
    body = CubePrimitive(pose, VEHICLE_SIZE_M, VEHICLE_COLOR)
    arrow = ArrowPrimitive(
        pose,
        shaft_length=0.75 * HEADING_ARROW_M,
        shaft_diameter=0.05 * HEADING_ARROW_M,
        head_length=0.25 * HEADING_ARROW_M,
        head_diameter=0.15 * HEADING_ARROW_M,
        color=VEHICLE_COLOR,
    )
    feet = (place, Point(place.x, place.y, 0.0))
    height = LinePrimitive(LineType.STRIP, Pose(), LINE_PIXELS, True, feet, VEHICLE_COLOR)
    text = label(f"{name} {place.z:.0f} m", Point(place.x, place.y, place.z + LABEL_ABOVE_M))
    return SceneUpdate(
        entities=(entity(time, name, cubes=(body,), arrows=(arrow,), lines=(height,), texts=(text,)),)
    )


class AgentScene:
    """Tracks as spheres, reports as pillars (opaque when marked), intelligence as circles of its uncertainty."""

    def __init__(self) -> None:
        self._tracks: AgentTracks | None = None
        self._reports: deque[TargetReport] = deque(maxlen=MAX_REPORTS)
        self._intelligence: dict[str, IntelligenceDocument] = {}

    def replace_tracks(self, tracks: AgentTracks) -> None:
        """Take in what the agent believes now."""
        self._tracks = tracks

    def add_report(self, report: TargetReport) -> None:
        """Take in a report; the oldest goes when there are more than MAX_REPORTS."""
        self._reports.append(report)

    def add_intelligence(self, intelligence: IntelligenceDocument) -> None:
        """Take in what the agent was told; one of the same id replaces the one before."""
        self._intelligence[intelligence.id] = intelligence

    def update(self, time: Time) -> SceneUpdate:
        """Everything so far: one entity of each kind, so that a track which is gone disappears."""
        return SceneUpdate(entities=tuple(self._entities(time)))

    def _entities(self, time: Time) -> Iterator[SceneEntity]:
        tracks = self._tracks.tracks if self._tracks is not None else ()
        ball_m = Vector3(TRACK_DIAMETER_M, TRACK_DIAMETER_M, TRACK_DIAMETER_M)
        yield entity(
            time,
            "tracks",
            spheres=tuple(
                SpherePrimitive(
                    Pose(Point(track.east_m, track.north_m, TRACK_DIAMETER_M / 2.0)), ball_m, TRACK_COLOR
                )
                for track in tracks
            ),
            texts=tuple(
                label(
                    f"{track.class_label} {track.confidence:.2f}",
                    Point(track.east_m, track.north_m, TRACK_DIAMETER_M + LABEL_ABOVE_M),
                    TRACK_COLOR,
                )
                for track in tracks
            ),
        )
        pillar_m = Vector3(REPORT_DIAMETER_M, REPORT_DIAMETER_M, REPORT_HEIGHT_M)
        yield entity(
            time,
            "reports",
            cylinders=tuple(
                CylinderPrimitive(
                    Pose(Point(report.east_m, report.north_m, REPORT_HEIGHT_M / 2.0)),
                    pillar_m,
                    color=MARK_COLOR if report.mark else REPORT_COLOR,
                )
                for report in self._reports
            ),
            texts=tuple(
                label(
                    f"{'marked' if report.mark else 'reported'} {report.class_label} {report.id}",
                    Point(report.east_m, report.north_m, REPORT_HEIGHT_M + LABEL_ABOVE_M),
                    LABEL_COLOR,
                )
                for report in self._reports
            ),
        )
        reports = tuple(self._intelligence.values())
        yield entity(
            time,
            "intelligence",
            lines=tuple(
                closed_line(circle(report.east_m, report.north_m, report.uncertainty_m), INTELLIGENCE_COLOR)
                for report in reports
            ),
            texts=tuple(
                label(
                    f"{report.id} {report.class_label}",
                    Point(report.east_m, report.north_m, LABEL_ABOVE_M),
                    INTELLIGENCE_COLOR,
                )
                for report in reports
            ),
        )

"""The messages that viewers know by name: `foxglove_msgs` of Foxglove's published schemas, release 2.1.0, as CDR.

They stand apart from `bench.streams.MESSAGES`, because none of them is ever on the air network.
"""

# Without `from __future__ import annotations` on purpose: the annotations are read at run time.

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from bench.streams import Header, Int32, Octets, Point, Pose, Time, UInt8, UInt32, UInt32s, Vector3

# Frozen, so all messages can share them.
_START, _NO_HEADER, _NO_POSE, _NO_SIZE = Time(), Header(), Pose(), Vector3()


class LineType(IntEnum):
    """How the points of a LinePrimitive are connected."""

    STRIP = 0
    LOOP = 1
    LIST = 2


class PointsType(IntEnum):
    """How the points of a PointsAnnotation are connected; other numbers than those of LineType."""

    LINE_LOOP = 2


class LogLevel(IntEnum):
    """Levels of a Log."""

    INFO = 2
    WARNING = 3


@dataclass(frozen=True, slots=True)
class Duration:
    TYPE: ClassVar[str] = "builtin_interfaces/msg/Duration"
    sec: Int32 = 0
    nanosec: UInt32 = 0


@dataclass(frozen=True, slots=True)
class Color:
    """Shares of red, green, blue, and opacity, 0 to 1."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/Color"
    r: float = 0.0
    g: float = 0.0
    b: float = 0.0
    a: float = 0.0


@dataclass(frozen=True, slots=True)
class KeyValuePair:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/KeyValuePair"
    key: str = ""
    value: str = ""


@dataclass(frozen=True, slots=True)
class SceneEntityDeletion:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/SceneEntityDeletion"
    timestamp: Time = _START
    type: UInt8 = 0
    id: str = ""


@dataclass(frozen=True, slots=True)
class ArrowPrimitive:
    """`pose` is that of the tail; without rotation the arrow points along x."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/ArrowPrimitive"
    pose: Pose = _NO_POSE
    shaft_length: float = 0.0
    shaft_diameter: float = 0.0
    head_length: float = 0.0
    head_diameter: float = 0.0
    color: Color = Color()


@dataclass(frozen=True, slots=True)
class CubePrimitive:
    """`pose` is that of the centre, `size` the length of each edge."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/CubePrimitive"
    pose: Pose = _NO_POSE
    size: Vector3 = _NO_SIZE
    color: Color = Color()


@dataclass(frozen=True, slots=True)
class SpherePrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/SpherePrimitive"
    pose: Pose = _NO_POSE
    size: Vector3 = _NO_SIZE
    color: Color = Color()


@dataclass(frozen=True, slots=True)
class CylinderPrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/CylinderPrimitive"
    pose: Pose = _NO_POSE
    size: Vector3 = _NO_SIZE
    bottom_scale: float = 1.0
    top_scale: float = 1.0
    color: Color = Color()


@dataclass(frozen=True, slots=True)
class LinePrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/LinePrimitive"
    type: UInt8 = 0
    pose: Pose = _NO_POSE
    thickness: float = 0.0
    scale_invariant: bool = False
    points: tuple[Point, ...] = ()
    color: Color = Color()
    colors: tuple[Color, ...] = ()
    indices: UInt32s = ()


@dataclass(frozen=True, slots=True)
class TriangleListPrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/TriangleListPrimitive"
    pose: Pose = _NO_POSE
    points: tuple[Point, ...] = ()
    color: Color = Color()
    colors: tuple[Color, ...] = ()
    indices: UInt32s = ()


@dataclass(frozen=True, slots=True)
class TextPrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/TextPrimitive"
    pose: Pose = _NO_POSE
    billboard: bool = False
    font_size: float = 0.0
    scale_invariant: bool = False
    color: Color = Color()
    text: str = ""


@dataclass(frozen=True, slots=True)
class ModelPrimitive:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/ModelPrimitive"
    pose: Pose = _NO_POSE
    scale: Vector3 = _NO_SIZE
    color: Color = Color()
    override_color: bool = False
    url: str = ""
    media_type: str = ""
    data: Octets = b""


@dataclass(frozen=True, slots=True)
class SceneEntity:
    """Replaces the entity of the same `id` on its topic; stays for ever when `lifetime` is zero."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/SceneEntity"
    timestamp: Time = _START
    frame_id: str = ""
    id: str = ""
    lifetime: Duration = Duration()
    frame_locked: bool = False
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[CubePrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[TriangleListPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[ModelPrimitive, ...] = ()


@dataclass(frozen=True, slots=True)
class SceneUpdate:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/SceneUpdate"
    deletions: tuple[SceneEntityDeletion, ...] = ()
    entities: tuple[SceneEntity, ...] = ()


@dataclass(frozen=True, slots=True)
class Point2:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/Point2"
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True, slots=True)
class CircleAnnotation:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/CircleAnnotation"
    timestamp: Time = _START
    position: Point2 = Point2()
    diameter: float = 0.0
    thickness: float = 0.0
    fill_color: Color = Color()
    outline_color: Color = Color()
    metadata: tuple[KeyValuePair, ...] = ()


@dataclass(frozen=True, slots=True)
class PointsAnnotation:
    """Points in pixels, from the top left corner of the picture."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/PointsAnnotation"
    timestamp: Time = _START
    type: UInt8 = 0
    points: tuple[Point2, ...] = ()
    outline_color: Color = Color()
    outline_colors: tuple[Color, ...] = ()
    fill_color: Color = Color()
    thickness: float = 0.0
    metadata: tuple[KeyValuePair, ...] = ()


@dataclass(frozen=True, slots=True)
class TextAnnotation:
    """`position` is the bottom left of the text, in pixels."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/TextAnnotation"
    timestamp: Time = _START
    position: Point2 = Point2()
    text: str = ""
    font_size: float = 0.0
    text_color: Color = Color()
    background_color: Color = Color()
    metadata: tuple[KeyValuePair, ...] = ()


@dataclass(frozen=True, slots=True)
class ImageAnnotations:
    """Lichtblick reads the stamps of the single annotations, Foxglove the one of the message."""

    TYPE: ClassVar[str] = "foxglove_msgs/msg/ImageAnnotations"
    timestamp: Time = _START
    circles: tuple[CircleAnnotation, ...] = ()
    points: tuple[PointsAnnotation, ...] = ()
    texts: tuple[TextAnnotation, ...] = ()
    metadata: tuple[KeyValuePair, ...] = ()


@dataclass(frozen=True, slots=True)
class Log:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/Log"
    timestamp: Time = _START
    level: UInt8 = 0
    message: str = ""
    name: str = ""
    file: str = ""
    line: UInt32 = 0


@dataclass(frozen=True, slots=True)
class GeoJSON:
    TYPE: ClassVar[str] = "foxglove_msgs/msg/GeoJSON"
    geojson: str = ""


@dataclass(frozen=True, slots=True)
class ViewerState:
    """The main states as numbers that a plot can draw, at each odometry of the truth. NaN is unknown.

    `height_m` is above the ground of the origin. `nearest_bystander_m` is a distance in space, to places that are up to
    0.5 s old. `estimate_error_m` is the distance in space from the true place to the vehicle's last estimate.
    """

    TYPE: ClassVar[str] = "rebar_msgs/msg/ViewerState"
    header: Header = _NO_HEADER
    height_m: float = 0.0
    ground_speed_mps: float = 0.0
    climb_mps: float = 0.0
    heading_deg: float = 0.0
    tilt_deg: float = 0.0
    home_distance_m: float = 0.0
    estimate_error_m: float = 0.0
    nearest_bystander_m: float = 0.0
    battery_percent: float = 0.0
    detections: UInt32 = 0
    tracks: UInt32 = 0
    reports: UInt32 = 0
    armed: bool = False
    landed: bool = False
    crashed: bool = False
    operator_link_up: bool = False
    mode: str = ""
    failsafe: str = ""
    phase: str = ""

"""The ROS 2 messages that the bench speaks, as frozen values; the table that everything else about them is
computed from.

A class is its own table: the annotations of its fields, in order, are the fields of the `.msg` file. Plain
`float` is float64; every other number names its width (`UInt32`). Constants of the `.msg` files are left out:
they are not on the wire.
"""

# Without `from __future__ import annotations` on purpose: the annotations are read at run time.

from typing import Annotated, ClassVar, Protocol

from bench.values import value_class

UInt8 = Annotated[int, "uint8"]
Int32 = Annotated[int, "int32"]
UInt32 = Annotated[int, "uint32"]
Octets = Annotated[bytes, "uint8[]"]
UInt32s = Annotated[tuple[int, ...], "uint32[]"]
Doubles = Annotated[tuple[float, ...], "float64[]"]
Nine = Annotated[tuple[float, ...], "float64[9]"]
Twelve = Annotated[tuple[float, ...], "float64[12]"]
ThirtySix = Annotated[tuple[float, ...], "float64[36]"]

_ZERO_9 = (0.0,) * 9
_ZERO_12 = (0.0,) * 12
_ZERO_36 = (0.0,) * 36


class RosMessage(Protocol):
    """What every message class has: its ROS 2 type name."""

    TYPE: ClassVar[str]


@value_class(frozen=True, slots=True)
class Time:
    TYPE: ClassVar[str] = "builtin_interfaces/msg/Time"
    sec: Int32 = 0
    nanosec: UInt32 = 0

    @staticmethod
    def of(ns: int) -> "Time":
        """The stamp of a simulated moment in nanoseconds."""
        return Time(*divmod(ns, 1_000_000_000))

    @property
    def ns(self) -> int:
        return self.sec * 1_000_000_000 + self.nanosec


@value_class(frozen=True, slots=True)
class Header:
    TYPE: ClassVar[str] = "std_msgs/msg/Header"
    stamp: Time = Time()
    frame_id: str = ""


@value_class(frozen=True, slots=True)
class String:
    TYPE: ClassVar[str] = "std_msgs/msg/String"
    data: str = ""


@value_class(frozen=True, slots=True)
class MultiArrayDimension:
    TYPE: ClassVar[str] = "std_msgs/msg/MultiArrayDimension"
    label: str = ""
    size: UInt32 = 0
    stride: UInt32 = 0


@value_class(frozen=True, slots=True)
class MultiArrayLayout:
    TYPE: ClassVar[str] = "std_msgs/msg/MultiArrayLayout"
    dim: tuple[MultiArrayDimension, ...] = ()
    data_offset: UInt32 = 0


@value_class(frozen=True, slots=True)
class UInt8MultiArray:
    TYPE: ClassVar[str] = "std_msgs/msg/UInt8MultiArray"
    layout: MultiArrayLayout = MultiArrayLayout()
    data: Octets = b""


@value_class(frozen=True, slots=True)
class Clock:
    TYPE: ClassVar[str] = "rosgraph_msgs/msg/Clock"
    clock: Time = Time()


@value_class(frozen=True, slots=True)
class Point:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Point"
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@value_class(frozen=True, slots=True)
class Quaternion:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Quaternion"
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@value_class(frozen=True, slots=True)
class Pose:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Pose"
    position: Point = Point()
    orientation: Quaternion = Quaternion()


@value_class(frozen=True, slots=True)
class PoseArray:
    TYPE: ClassVar[str] = "geometry_msgs/msg/PoseArray"
    header: Header = Header()
    poses: tuple[Pose, ...] = ()


@value_class(frozen=True, slots=True)
class PoseWithCovariance:
    TYPE: ClassVar[str] = "geometry_msgs/msg/PoseWithCovariance"
    pose: Pose = Pose()
    covariance: ThirtySix = _ZERO_36


@value_class(frozen=True, slots=True)
class Vector3:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Vector3"
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@value_class(frozen=True, slots=True)
class Transform:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Transform"
    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


@value_class(frozen=True, slots=True)
class TransformStamped:
    TYPE: ClassVar[str] = "geometry_msgs/msg/TransformStamped"
    header: Header = Header()
    child_frame_id: str = ""
    transform: Transform = Transform()


@value_class(frozen=True, slots=True)
class Twist:
    TYPE: ClassVar[str] = "geometry_msgs/msg/Twist"
    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


@value_class(frozen=True, slots=True)
class TwistWithCovariance:
    TYPE: ClassVar[str] = "geometry_msgs/msg/TwistWithCovariance"
    twist: Twist = Twist()
    covariance: ThirtySix = _ZERO_36


@value_class(frozen=True, slots=True)
class TFMessage:
    TYPE: ClassVar[str] = "tf2_msgs/msg/TFMessage"
    transforms: tuple[TransformStamped, ...] = ()


@value_class(frozen=True, slots=True)
class Odometry:
    """Pose in the header's frame, twist in the child frame."""

    TYPE: ClassVar[str] = "nav_msgs/msg/Odometry"
    header: Header = Header()
    child_frame_id: str = ""
    pose: PoseWithCovariance = PoseWithCovariance()
    twist: TwistWithCovariance = TwistWithCovariance()


@value_class(frozen=True, slots=True)
class RegionOfInterest:
    TYPE: ClassVar[str] = "sensor_msgs/msg/RegionOfInterest"
    x_offset: UInt32 = 0
    y_offset: UInt32 = 0
    height: UInt32 = 0
    width: UInt32 = 0
    do_rectify: bool = False


@value_class(frozen=True, slots=True)
class CameraInfo:
    """`k`, `r` (3x3) and `p` (3x4) are row-major, in pixels, of the optical frame (z forward, x right, y
    down).
    """

    TYPE: ClassVar[str] = "sensor_msgs/msg/CameraInfo"
    header: Header = Header()
    height: UInt32 = 0
    width: UInt32 = 0
    distortion_model: str = ""
    d: Doubles = ()
    k: Nine = _ZERO_9
    r: Nine = _ZERO_9
    p: Twelve = _ZERO_12
    binning_x: UInt32 = 0
    binning_y: UInt32 = 0
    roi: RegionOfInterest = RegionOfInterest()


@value_class(frozen=True, slots=True)
class CompressedImage:
    TYPE: ClassVar[str] = "sensor_msgs/msg/CompressedImage"
    header: Header = Header()
    format: str = ""
    data: Octets = b""


@value_class(frozen=True, slots=True)
class Image:
    TYPE: ClassVar[str] = "sensor_msgs/msg/Image"
    header: Header = Header()
    height: UInt32 = 0
    width: UInt32 = 0
    encoding: str = ""
    is_bigendian: UInt8 = 0
    step: UInt32 = 0
    data: Octets = b""


@value_class(frozen=True, slots=True)
class Point2D:
    TYPE: ClassVar[str] = "vision_msgs/msg/Point2D"
    x: float = 0.0
    y: float = 0.0


@value_class(frozen=True, slots=True)
class Pose2D:
    TYPE: ClassVar[str] = "vision_msgs/msg/Pose2D"
    position: Point2D = Point2D()
    theta: float = 0.0


@value_class(frozen=True, slots=True)
class BoundingBox2D:
    """Centre and full size, in pixels."""

    TYPE: ClassVar[str] = "vision_msgs/msg/BoundingBox2D"
    center: Pose2D = Pose2D()
    size_x: float = 0.0
    size_y: float = 0.0


@value_class(frozen=True, slots=True)
class ObjectHypothesis:
    TYPE: ClassVar[str] = "vision_msgs/msg/ObjectHypothesis"
    class_id: str = ""
    score: float = 0.0


@value_class(frozen=True, slots=True)
class ObjectHypothesisWithPose:
    TYPE: ClassVar[str] = "vision_msgs/msg/ObjectHypothesisWithPose"
    hypothesis: ObjectHypothesis = ObjectHypothesis()
    pose: PoseWithCovariance = PoseWithCovariance()


@value_class(frozen=True, slots=True)
class Detection2D:
    TYPE: ClassVar[str] = "vision_msgs/msg/Detection2D"
    header: Header = Header()
    results: tuple[ObjectHypothesisWithPose, ...] = ()
    bbox: BoundingBox2D = BoundingBox2D()
    id: str = ""


@value_class(frozen=True, slots=True)
class Detection2DArray:
    TYPE: ClassVar[str] = "vision_msgs/msg/Detection2DArray"
    header: Header = Header()
    detections: tuple[Detection2D, ...] = ()


MESSAGES: tuple[type[RosMessage], ...] = (
    *(Time, Header, String, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray, Clock),
    *(Point, Quaternion, Pose, PoseArray, PoseWithCovariance),
    *(Vector3, Transform, TransformStamped, Twist, TwistWithCovariance, TFMessage, Odometry),
    *(RegionOfInterest, CameraInfo, CompressedImage, Image),
    *(Point2D, Pose2D, BoundingBox2D, ObjectHypothesis, ObjectHypothesisWithPose),
    *(Detection2D, Detection2DArray),
)

BY_NAME = {kind.TYPE: kind for kind in MESSAGES}


def message_class(type_name: str) -> type[RosMessage] | None:
    """The class of a ROS 2 type (`std_msgs/msg/String`), or None when the bench does not speak it."""
    return BY_NAME.get(type_name)


def type_name_of(kind: type[object]) -> str:
    """The ROS 2 type of a message class. Raises TypeError for any other class."""
    name = getattr(kind, "TYPE", None)
    if not isinstance(name, str):
        raise TypeError(f"{kind.__name__} is no message class of bench.streams")
    return name

"""The ROS 2 wire over Zenoh, with no ROS: messages, CDR, keys and graph, an embedded router, publishers and
subscriptions.

    with open_router(AirPlan(7, agent_reads=((CLOCK, Clock.TYPE),), agent_writes=())) as router:
        clock = router.node("bench").publisher(CLOCK, Clock, CLOCK_QOS)
        with open_client(router.access, "agent") as node:  # in truth in the agent's own process
            heard = node.subscribe(CLOCK, Clock)
            ...
            clock.put(Clock(Time.of(now_ns)))
            heard.wait(clock.sequence, timeout_s=1.0)

docs/streams.md says how a ROS 2 node or a program in another language joins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._ap_dds import AP_FROM_AGENT as AP_FROM_AGENT
    from ._ap_dds import AP_QOS as AP_QOS
    from ._ap_dds import AP_SERVICES as AP_SERVICES
    from ._ap_dds import AP_TO_AGENT as AP_TO_AGENT
    from ._ap_dds import ap_message as ap_message
    from ._ap_dds import filled as filled
    from ._cdr import decode as decode
    from ._cdr import encode as encode
    from ._json import json_schema as json_schema
    from ._json import json_value as json_value
    from ._keys import CLOCK_QOS as CLOCK_QOS
    from ._keys import RELIABLE_10 as RELIABLE_10
    from ._keys import SENSOR_DATA as SENSOR_DATA
    from ._keys import TF_QOS as TF_QOS
    from ._keys import QoS as QoS
    from ._keys import data_key as data_key
    from ._keys import dds_name as dds_name
    from ._node import AirAccess as AirAccess
    from ._node import Publisher as Publisher
    from ._node import RosNode as RosNode
    from ._node import Sample as Sample
    from ._node import Service as Service
    from ._node import Subscription as Subscription
    from ._node import open_client as open_client
    from ._poses import decode_pose_array as decode_pose_array
    from ._poses import encode_pose_array as encode_pose_array
    from ._px4 import PX4_FROM_AGENT as PX4_FROM_AGENT
    from ._px4 import PX4_RELEASES as PX4_RELEASES
    from ._px4 import PX4_TO_AGENT as PX4_TO_AGENT
    from ._px4 import px4_message as px4_message
    from ._px4 import px4_names as px4_names
    from ._px4 import px4_plain_name as px4_plain_name
    from ._px4 import px4_releases_of as px4_releases_of
    from ._router import AP_PREFIX as AP_PREFIX
    from ._router import MAX_DOCUMENT_BYTES as MAX_DOCUMENT_BYTES
    from ._router import PX4_PREFIX as PX4_PREFIX
    from ._router import AirPlan as AirPlan
    from ._router import Endpoint as Endpoint
    from ._router import Router as Router
    from ._router import Topic as Topic
    from ._router import open_router as open_router
    from ._schemas import schema_text as schema_text
    from ._schemas import service_parts as service_parts
    from ._schemas import type_hash as type_hash
    from ._types import MESSAGES as MESSAGES
    from ._types import BoundingBox2D as BoundingBox2D
    from ._types import CameraInfo as CameraInfo
    from ._types import Clock as Clock
    from ._types import CompressedImage as CompressedImage
    from ._types import Detection2D as Detection2D
    from ._types import Detection2DArray as Detection2DArray
    from ._types import Header as Header
    from ._types import Image as Image
    from ._types import Int32 as Int32
    from ._types import MultiArrayDimension as MultiArrayDimension
    from ._types import MultiArrayLayout as MultiArrayLayout
    from ._types import ObjectHypothesis as ObjectHypothesis
    from ._types import ObjectHypothesisWithPose as ObjectHypothesisWithPose
    from ._types import Octets as Octets
    from ._types import Odometry as Odometry
    from ._types import Point as Point
    from ._types import Point2D as Point2D
    from ._types import Pose as Pose
    from ._types import Pose2D as Pose2D
    from ._types import PoseArray as PoseArray
    from ._types import PoseWithCovariance as PoseWithCovariance
    from ._types import Quaternion as Quaternion
    from ._types import RegionOfInterest as RegionOfInterest
    from ._types import RosMessage as RosMessage
    from ._types import String as String
    from ._types import TFMessage as TFMessage
    from ._types import Time as Time
    from ._types import Transform as Transform
    from ._types import TransformStamped as TransformStamped
    from ._types import Twist as Twist
    from ._types import TwistWithCovariance as TwistWithCovariance
    from ._types import UInt8 as UInt8
    from ._types import UInt8MultiArray as UInt8MultiArray
    from ._types import UInt32 as UInt32
    from ._types import UInt32s as UInt32s
    from ._types import Vector3 as Vector3
    from ._types import message_class as message_class
    from ._types import type_name_of as type_name_of

__getattr__ = lazy_names(__name__)

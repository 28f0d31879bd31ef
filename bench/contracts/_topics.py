"""The names of the streams. `{v}` is the vehicle's name in the SimSpec, `{c}` a camera's.

The *air network* is what a real aircraft would have: the agent reaches these topics over Zenoh. The *bench
network* carries the truth and exists only inside the session's process and in the recording.
"""

from __future__ import annotations

from bench.values import value_class

# Air network, bench to agent.
# tf2_msgs/msg/TFMessage, map -> {v}/base_link as the vehicle itself estimates it. {v}/base_level has its
# place and yaw alone:
# a camera mount that stays level hangs on it.
TF = "/tf"
# tf2_msgs/msg/TFMessage, latched: the frame that carries the camera -> its optical frame.
TF_STATIC = "/tf_static"

# Bench network.
TRUTH_ODOMETRY = "/truth/odometry"  # nav_msgs/msg/Odometry, map (ENU) -> base_link (FLU)
TRUTH_CAST = "/truth/cast"  # std_msgs/msg/String, CastDocument: who the actors are, once at the start
TRUTH_ACTORS = "/truth/actors"  # geometry_msgs/msg/PoseArray, map (ENU), in the order of the cast
# std_msgs/msg/String, PictureDocument: each rendered picture's digest, at its exposure
TRUTH_PICTURES = "/truth/pictures"
TRUTH_VIEW = "/truth/view"  # std_msgs/msg/String, ViewDocument: who could be seen in each camera frame
# std_msgs/msg/String, VehicleDocument: armed, mode, landed, battery; on change and at 1 Hz
TRUTH_VEHICLE = "/truth/vehicle"
# std_msgs/msg/String, EventDocument: the session's own log, its end included
SESSION_EVENTS = "/session/events"


@value_class(frozen=True, slots=True)
class VehicleTopics:
    """The topics that carry a vehicle's name."""

    vehicle: str

    @property
    def mission(self) -> str:
        """std_msgs/msg/String, MissionOrder, latched."""
        return f"/{self.vehicle}/mission"

    @property
    def intelligence(self) -> str:
        """std_msgs/msg/String, IntelligenceDocument, latched with a depth of 32."""
        return f"/{self.vehicle}/intelligence"

    @property
    def orders(self) -> str:
        """std_msgs/msg/String, OrderDocument, latched with a depth of 32."""
        return f"/{self.vehicle}/orders"

    @property
    def consents(self) -> str:
        """std_msgs/msg/String, ConsentAnswer, latched with a depth of 32."""
        return f"/{self.vehicle}/consents"

    @property
    def operator_link(self) -> str:
        """std_msgs/msg/String, OperatorLinkDocument, latched: at the start and on change."""
        return f"/{self.vehicle}/operator_link"

    @property
    def detections(self) -> str:
        """vision_msgs/msg/Detection2DArray in pixels; the header's stamp is the moment of exposure."""
        return f"/{self.vehicle}/detections"

    def camera_detections(self, camera: str) -> str:
        """The same of a further camera, in its own pixels."""
        return f"/{self.vehicle}/camera/{camera}/detections"

    def camera_info(self, camera: str) -> str:
        """sensor_msgs/msg/CameraInfo with the stamp of the frame."""
        return f"/{self.vehicle}/camera/{camera}/camera_info"

    def image_raw(self, camera: str) -> str:
        """sensor_msgs/msg/Image in bgr8 with the stamp of the frame, while somebody listens."""
        return f"/{self.vehicle}/camera/{camera}/image_raw"

    def image_compressed(self, camera: str) -> str:
        """sensor_msgs/msg/CompressedImage (JPEG) with the stamp of the frame, while somebody listens."""
        return f"{self.image_raw(camera)}/compressed"

    def is_of_camera(self, topic: str) -> bool:
        """Whether this is a topic that a camera of some name has."""
        camera = topic.removeprefix(f"/{self.vehicle}/camera/").partition("/")[0]
        return topic in (
            self.camera_detections(camera),
            self.camera_info(camera),
            self.image_raw(camera),
            self.image_compressed(camera),
        )

    # Air network, agent to bench. All are std_msgs/msg/String with a JSON document.

    @property
    def reports(self) -> str:
        """TargetReport: a target identified, and whether it is marked."""
        return f"/{self.vehicle}/agent/reports"

    @property
    def decisions(self) -> str:
        """Decision: what the agent decided, when and why."""
        return f"/{self.vehicle}/agent/decisions"

    @property
    def status(self) -> str:
        """AgentStatus: phase of the mission; `complete` ends the session after landing."""
        return f"/{self.vehicle}/agent/status"

    @property
    def tracks(self) -> str:
        """AgentTracks: what the agent believes to be where."""
        return f"/{self.vehicle}/agent/tracks"

    @property
    def answers(self) -> str:
        """OrderAnswer: whether an order is accepted, and why not."""
        return f"/{self.vehicle}/agent/answers"

    @property
    def consent_requests(self) -> str:
        """ConsentRequest: whether a target may be marked."""
        return f"/{self.vehicle}/agent/consent_requests"

    @property
    def from_agent(self) -> tuple[str, ...]:
        """All topics on which the agent may write."""
        return (self.reports, self.decisions, self.status, self.tracks, self.answers, self.consent_requests)


def truth_mask_topic(camera: str) -> str:
    """Bench-network topic of a camera's instance masks.

    sensor_msgs/msg/CompressedImage, format `mono16; png compressed`: 1 + the actor's place in the cast, 0 for none.
    """
    return f"/truth/{camera}/mask"


def truth_depth_topic(camera: str) -> str:
    """Bench-network topic of a camera's depths.

    sensor_msgs/msg/CompressedImage, format `32FC1; tiff compressed`: metres along the optical axis, exact, infinite in the
    sky (REP 117, REP 118).
    """
    return f"/truth/{camera}/depth"


def mavlink_topic(link: str, direction: str) -> str:
    """Bench-network topic (std_msgs/msg/UInt8MultiArray) of the raw MAVLink bytes of one step.

    `direction` is `to_agent` or `from_agent`; the data are whole frames, one after the other, in order.
    """
    return f"/mavlink/{link}/{direction}"


# The operator's ground station, which flies the vehicle while it is handed over.
OPERATOR_LINK = "operator_station"
# Names of the events in /session/events between which the operator flies.
OPERATOR_TAKES, OPERATOR_GIVES_BACK = "operator takes the vehicle", "operator gives the vehicle back"

# Name of the event in /session/events whose text is what draws a camera's pictures: renderer and build of OpenCV.
CAMERA_OPENED = "camera opened"
# Name of the event whose text says which detector works on the pictures.
DETECTOR_OPENED = "detector opened"
# Name of the event whose text says which real autopilot flies, with version, digest and pace.
FIRMWARE_BOOTED = "firmware booted"


def is_mavlink_from_agent(topic: str) -> bool:
    """Whether a topic holds raw MAVLink that the agent sent, on any link but the operator's."""
    sent = topic.startswith("/mavlink/") and topic.endswith("/from_agent")
    return sent and topic != mavlink_topic(OPERATOR_LINK, "from_agent")

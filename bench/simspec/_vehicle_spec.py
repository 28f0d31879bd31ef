"""The vehicle: aircraft, autopilot, sensors, and failures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, JsonValue, Tag, model_validator

from bench.documents import Document, added_field

from ._faults import Failure
from ._ground import Home
from ._quantities import Fraction, Identifier, RosName


class Gps(Document):
    """Error of satellite navigation: a slow second-order Gauss-Markov error, and white noise of each fix."""

    wander_m: float = Field(
        0.3, ge=0.0, le=50.0, description="Standard deviation of the slow horizontal error."
    )
    wander_time_s: float = Field(60.0, gt=0.0, le=3600.0, description="Correlation time of the slow error.")
    noise_m: float = Field(
        0.05,
        ge=0.0,
        le=20.0,
        description="Standard deviation of the white horizontal noise of one fix; the vertical one is 1.5 times that.",
    )


Coefficient = Annotated[float, Field(ge=-10.0, le=10.0)]


class Distortion(Document):
    """Distortion of a lens: the coefficients of Brown's model, which ROS calls `plumb_bob`.

    k1, k2 and k3 are radial, p1 and p2 tangential, as OpenCV's calibration gives them. `horizontal_fov_deg` is the
    field of view of the lens without its distortion.
    """

    k1: Coefficient = 0.0
    k2: Coefficient = 0.0
    p1: Coefficient = 0.0
    p2: Coefficient = 0.0
    k3: Coefficient = 0.0

    @property
    def coefficients(self) -> tuple[float, float, float, float, float]:
        """In the order of sensor_msgs/CameraInfo: k1, k2, p1, p2, k3."""
        return self.k1, self.k2, self.p1, self.p2, self.k3


NO_LENS_DISTORTION = Distortion()

DEFAULT_RENDERER = "opencv"
"""The renderer that every installation has."""

DEFAULT_VEHICLE = "x500"


class Camera(Document):
    """One camera. When `stabilized`, its mount keeps roll and pitch level."""

    name: RosName = "front"
    width_px: int = Field(1280, ge=16, le=8192)
    height_px: int = Field(720, ge=16, le=8192)
    horizontal_fov_deg: float = Field(70.0, gt=5.0, lt=150.0)
    tilt_deg: float = Field(
        60.0, ge=0.0, le=90.0, description="Angle of the optical axis below the horizon; 90 is straight down."
    )
    stabilized: bool = True
    rate_hz: float = Field(5.0, gt=0.0, le=50.0)
    # Fields that came later are left out at their defaults, so that digests of published SimSpecs stay.
    distortion: Distortion = added_field(
        NO_LENS_DISTORTION, "Distortion of the lens, in pictures, camera_info and the boxes of detections."
    )
    gimbal: bool = Field(
        False, description="Whether MAVLink (gimbal protocol v2) can turn the mount. It starts at tilt_deg."
    )
    # 100 is MAV_COMP_ID_CAMERA of MAVLink's common.xml.
    mavlink: bool = Field(
        False, description="Whether the camera answers on the vehicle's MAVLink links, as component 100."
    )
    record_frames: bool = added_field(
        False,
        "Whether every picture is rendered, and recorded as JPEG, also when nobody listens to the pictures.",
    )
    record_boxes: bool = added_field(
        False,
        "Whether every picture is rendered, and the box and the visible share of each actor in it recorded.",
    )
    record_masks: bool = added_field(
        False, "Whether every picture is rendered, and recorded which actor each of its pixels shows."
    )
    record_depth: bool = added_field(
        False, "Whether every picture is rendered, and the depth of each of its pixels recorded."
    )
    renderer: Identifier = added_field(
        DEFAULT_RENDERER, "What draws the pictures: an entry point of group rebar.renderers."
    )

    # What the camera does to its pictures. Detections from the truth know nothing of it.
    noise: float = added_field(1.0, "Factor on the noise of the camera's pictures.", ge=0.0, le=20.0)
    lens_dirt: Fraction = added_field(0.0, "Dirt on the lens: 0 is clean.")
    dropped_share: Fraction = added_field(0.0, "Probability that the camera loses the picture of a frame.")
    frozen_share: Fraction = added_field(
        0.0, "Share of the frames in which the camera repeats its last picture, some five in a row."
    )
    exposure_ev: float = added_field(
        0.0,
        "Exposure of the pictures against the automatic one, in stops: +1 is twice as bright.",
        ge=-5.0,
        le=5.0,
    )
    shutter_s: float | None = added_field(
        None,
        "Time for which the shutter is open, which blurs what moves; when absent the camera chooses 1/2000 s to "
        "1/60 s by the light.",
        ge=1e-5,
        le=1.0,
    )

    @property
    def draws_for_the_recording(self) -> bool:
        """Whether every picture is rendered, also when nobody listens."""
        return self.record_frames or self.record_boxes or self.record_masks or self.record_depth

    @model_validator(mode="after")
    def _gimbal_is_level(self) -> Self:
        if self.gimbal and not self.stabilized:
            raise ValueError("a gimbal keeps the camera level: set stabilized to true or gimbal to false")
        return self


class Battery(Document):
    """The battery, and its charge at the start."""

    capacity_wh: float = Field(80.0, gt=0.0, le=2000.0)
    initial_fraction: float = Field(1.0, gt=0.0, le=1.0)


DEFAULT_BAUD = 921600
"""That of PX4's second telemetry port, and the best of most USB adapters."""


class OutsideLink(Document):
    """A MAVLink link that leads out of the session, to the network of the host or to a serial device: for a ground station
    that looks on, or a companion computer that flies.

    `udp_out` sends to `host`:`port`; `udp_in` and `tcp_in` listen there, or on a named `interface`; `serial` is a
    `device`. The agent cannot reach it. What comes over
    it is discarded, and what goes over it is not recorded, unless `heard`.
    """

    name: Identifier = Field(description="Another name than the agent's links have.")
    kind: Literal["udp_out", "udp_in", "tcp_in", "serial"] = "udp_out"
    host: str = "127.0.0.1"
    interface: str = added_field(
        "", "Network interface of the host to listen on, such as eth0, in place of `host`.", max_length=15
    )
    device: str = added_field("", "The serial device, such as /dev/serial/by-id/usb-... or /dev/ttyUSB0.")
    baud: int = added_field(DEFAULT_BAUD, "Speed of the serial device.", ge=9600, le=4_000_000)
    port: int = Field(14550, ge=1, le=65535)
    streams: Literal["onboard", "gcs", "none"] = Field("gcs", description="Default stream set of the link.")
    heard: bool = Field(
        False,
        description="Whether the vehicle obeys what comes over the link. Such a session cannot be repeated bit for bit.",
    )

    @model_validator(mode="after")
    def _fields_fit_the_kind(self) -> Self:
        if ":" in self.host:
            raise ValueError(
                f"host {self.host!r}: links have no IPv6; give an IPv4 address or a name, without port"
            )
        if (self.kind == "serial") != bool(self.device):
            raise ValueError("a link of kind serial needs a device, and only such a link has one")
        if self.interface and self.kind not in ("udp_in", "tcp_in"):
            raise ValueError(f"{self.kind} does not listen: an interface is for udp_in and tcp_in")
        return self


class RealAutopilot(Document):
    """A real autopilot: its own program flies, and the bench is its physics (docs/real-autopilots.md)."""

    kind: Literal["px4", "ardupilot"]
    firmware: str = Field(
        min_length=1,
        description="PX4: the folder that holds bin/px4 and etc/. ArduPilot: the program arducopter. Relative to the "
        "current folder.",
    )
    parameters: dict[str, float] = Field(
        {}, description="Set before the start, behind those of the airframe and those of vehicle.parameters."
    )
    boot_s: float | None = Field(
        None,
        ge=0.0,
        le=600.0,
        description="Simulated seconds on the ground before the session begins, until the autopilot can be armed; 15 "
        "for px4 and 50 for ardupilot when absent.",
    )
    pace: Literal["free", "one_core", "quiet"] = Field(
        default_factory=lambda values: "quiet" if values.get("kind") == "px4" else "one_core",
        description="`one_core`: autopilot and physics take turns on one core, which is fastest. `quiet`: as well, each "
        "sample waits until every thread of the autopilot sleeps, so that PX4 repeats. `free`: wherever the system "
        "puts them. When absent `quiet` for px4, and `one_core` for ardupilot, which has one thread.",
    )
    log: bool = Field(
        False,
        description="Whether the autopilot writes its log, some 0.3 MB a second; it is kept with the run.",
    )

    @model_validator(mode="before")
    @classmethod
    def _boards_have_a_plugin(cls, value: object) -> object:
        if isinstance(value, Mapping) and "device" in value:
            raise ValueError(
                "a board is flown by a package: pip install examples/boards, and write "
                "autopilot: {kind: px4-board, options: {device: ...}} (docs/hardware.md)"
            )
        return value

    def __str__(self) -> str:
        return f"{self.kind} (real)"


class PluginAutopilot(Document):
    """A real autopilot that an installed package flies, by its name in the entry-point group rebar.firmware."""

    kind: Identifier
    options: dict[str, JsonValue] = Field({}, description="Options of the plug-in, which checks them.")
    boot_s: float | None = Field(
        None,
        ge=0.0,
        le=600.0,
        description="Simulated seconds on the ground before the session begins, until the autopilot can be armed; when "
        "absent the plug-in chooses.",
    )

    def __str__(self) -> str:
        return f"{self.kind} (real)"


def _autopilot_form(value: object) -> str:
    """Which form of `autopilot` a value has: its faults are then those of that form alone."""
    if isinstance(value, Mapping):
        kind = RealAutopilot if value.get("kind") in ("px4", "ardupilot") else PluginAutopilot
        return kind.__name__
    return type(value).__name__ if isinstance(value, RealAutopilot | PluginAutopilot) else "imitated"


class VehicleSpec(Document):
    """The aircraft, the autopilot it carries, and its sensors."""

    model: Identifier = Field(
        DEFAULT_VEHICLE, description="Name of the vehicle in the entry-point group rebar.vehicles."
    )
    autopilot: Annotated[
        Annotated[Literal["px4", "ardupilot"], Tag("imitated")]
        | Annotated[RealAutopilot, Tag("RealAutopilot")]
        | Annotated[PluginAutopilot, Tag("PluginAutopilot")],
        Discriminator(_autopilot_form),
    ] = Field(
        "px4",
        description="The autopilot that the flight controller imitates, a real one with its firmware, or one of a plug-in.",
    )
    parameters: dict[str, float] = Field(
        {}, description="Autopilot parameters that are set before the start, by the names of that autopilot."
    )
    name: RosName = Field("vehicle_1", description="Namespace of the vehicle's topics.")
    home: Home = Home(east_m=0.0, north_m=0.0)
    gps: Gps = Gps()
    camera: Camera = Field(
        Camera(),
        description="The main camera, which always has detections; the MAVLink camera and gimbal are its own.",
    )
    more_cameras: tuple[Camera, ...] = added_field(
        (),
        "Further cameras, which give pictures, and detections where perception.more_cameras names them. With "
        "`gimbal`, one hangs on the main camera's gimbal.",
        max_length=7,
    )
    battery: Battery = Battery()
    ground_truth: bool = Field(
        False,
        description="Whether the vehicle sends its true motion (HIL_STATE_QUATERNION) when asked for it.",
    )
    # Frozen questions are compared by digest, and none of them gives an agent the simulation.
    simulation_control: bool = added_field(
        False,
        "Whether MAVLink clients, the agent among them, may set the parameters of the simulation (PX4: "
        "SIM_*, SIH_*, SYS_FAILURE_EN, SYS_HITL; ArduPilot: SIM_*) and inject failures.",
    )
    failures: tuple[Failure, ...] = Field((), max_length=100, description="Failures of the vehicle.")
    outside_links: tuple[OutsideLink, ...] = added_field(
        (), "MAVLink links to the host's network, such as for a ground station.", max_length=8
    )

    @model_validator(mode="after")
    def _outside_links_have_names(self) -> Self:
        names = [link.name for link in self.outside_links]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"outside_links: the name {twice[0]!r} stands twice; give each link its own")
        return self

    @model_validator(mode="after")
    def _cameras_fit_together(self) -> Self:
        names = [camera.name for camera in self.cameras]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(
                f"more_cameras: the name {twice[0]!r} stands twice; give each camera its own name (vehicle.camera has "
                f"{self.camera.name!r})"
            )
        for index, camera in enumerate(self.more_cameras):
            if camera.mavlink:
                raise ValueError(
                    f"more_cameras[{index}].mavlink: only the main camera answers on MAVLink; set mavlink of "
                    "vehicle.camera instead"
                )
            if camera.gimbal and not self.camera.gimbal:
                raise ValueError(
                    f"more_cameras[{index}].gimbal: the gimbal is the main camera's; set gimbal of vehicle.camera to true too"
                )
            # One gimbal has one direction: another tilt would be ignored without a word.
            if camera.gimbal and camera.tilt_deg != self.camera.tilt_deg:
                raise ValueError(
                    f"more_cameras[{index}].tilt_deg: cameras on one gimbal look the same way; give it the tilt_deg of "
                    f"vehicle.camera, {self.camera.tilt_deg:g}"
                )
        return self

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Every camera of the vehicle, the main one first."""
        return self.camera, *self.more_cameras

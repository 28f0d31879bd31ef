"""The vehicle: aircraft, autopilot, sensors, and what breaks."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

from ._ground import Home
from ._quantities import Identifier, RosName


class Gps(Document):
    """Satellite navigation error: a slow second-order Gauss-Markov wander plus white noise per fix."""

    wander_m: Annotated[float, Field(ge=0.0, le=50.0, description="Standard deviation of the slow horizontal error.")] = 0.3
    wander_time_s: Annotated[float, Field(gt=0.0, le=3600.0, description="Correlation time of the slow error.")] = 60.0
    noise_m: Annotated[float, Field(ge=0.0, le=20.0, description="White horizontal noise of one fix; vertical is 1.5 times.")] = (
        0.05
    )


class Camera(Document):
    """One camera, on a mount that keeps roll and pitch level when `stabilized`."""

    name: RosName = "front"
    width_px: Annotated[int, Field(ge=16, le=8192)] = 1280
    height_px: Annotated[int, Field(ge=16, le=8192)] = 720
    horizontal_fov_deg: Annotated[float, Field(gt=5.0, lt=150.0)] = 70.0
    tilt_deg: Annotated[float, Field(ge=0.0, le=90.0, description="Optical axis below the horizon; 90 looks straight down.")] = (
        60.0
    )
    stabilized: bool = True
    rate_hz: Annotated[float, Field(gt=0.0, le=50.0)] = 5.0
    gimbal: Annotated[
        bool, Field(description="The mount can be turned over MAVLink (gimbal protocol v2); tilt_deg is where it starts.")
    ] = False
    mavlink: Annotated[bool, Field(description="The camera answers on the vehicle's links, as component 100.")] = False

    @model_validator(mode="after")
    def _gimbal_is_level(self) -> Self:
        if self.gimbal and not self.stabilized:
            raise ValueError("a gimbal keeps the camera level; leave stabilized true or gimbal false")
        return self


class Battery(Document):
    capacity_wh: Annotated[float, Field(gt=0.0, le=2000.0)] = 80.0
    initial_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


_FAILURE_FIELDS = {
    "gps_off": {"duration_s"},
    "gps_drift": {"duration_s", "drift_mps", "towards_deg"},
    "battery_drop": {"to_fraction"},
    "motor_off": {"duration_s", "instance"},
    "link_loss": {"duration_s", "link"},
}


class Failure(Document):
    """Something of the vehicle that breaks at `at_s`, and works again after `duration_s` when that is given.

    `gps_off`: no more fixes. `gps_drift`: fixes walk away with `drift_mps` towards `towards_deg` and jump back at the end.
    `battery_drop`: charge falls to `to_fraction` at once. `motor_off`: rotor `instance` stops. `link_loss`: nothing passes
    in either direction of the MAVLink link of that name, or of all links.
    """

    at_s: Annotated[float, Field(ge=0.0, le=7200.0, description="Simulated time.")]
    kind: Literal["gps_off", "gps_drift", "battery_drop", "motor_off", "link_loss"]
    duration_s: Annotated[float | None, Field(gt=0.0, le=7200.0, description="To the end of the session when absent.")] = None
    instance: Annotated[int | None, Field(ge=1, le=16, description="Rotor, counted from 1 as the autopilot counts.")] = None
    link: Annotated[Identifier | None, Field(description="Link, by its name in the agent's manifest; all when absent.")] = None
    to_fraction: Annotated[float | None, Field(ge=0.0, le=1.0, description="Charge that is left.")] = None
    drift_mps: Annotated[float | None, Field(gt=0.0, le=50.0)] = None
    towards_deg: Annotated[float | None, Field(ge=0.0, lt=360.0, description="Clockwise from north; north when absent.")] = None

    @model_validator(mode="after")
    def _fields_fit_the_kind(self) -> Self:
        given = {name for name in self.model_fields_set if getattr(self, name) is not None} - {"at_s", "kind"}
        if wrong := sorted(given - _FAILURE_FIELDS[self.kind]):
            raise ValueError(f"{self.kind} has no {', '.join(wrong)}; it has {', '.join(sorted(_FAILURE_FIELDS[self.kind]))}")
        needed = {"gps_drift": "drift_mps", "battery_drop": "to_fraction", "motor_off": "instance"}.get(self.kind)
        if needed and needed not in given:
            raise ValueError(f"{self.kind} needs {needed}")
        return self


class VehicleSpec(Document):
    """The aircraft, the autopilot it carries, and its sensors."""

    model: Annotated[Identifier, Field(description="Vehicle, by its name in the entry-point group rebar.vehicles.")] = "x500"
    autopilot: Annotated[Literal["px4", "ardupilot"], Field(description="Personality of the flight controller.")] = "px4"
    parameters: Annotated[
        dict[str, float], Field(description="Autopilot parameters set before start, by the autopilot's own names.")
    ] = {}
    name: Annotated[RosName, Field(description="Namespace of the vehicle's topics.")] = "vehicle_1"
    home: Home = Home(east_m=0.0, north_m=0.0)
    gps: Gps = Gps()
    camera: Camera = Camera()
    battery: Battery = Battery()
    ground_truth: Annotated[
        bool, Field(description="Whether the vehicle tells its true motion (HIL_STATE_QUATERNION) to whoever asks for it.")
    ] = False
    failures: Annotated[tuple[Failure, ...], Field(max_length=100, description="What breaks, and when.")] = ()

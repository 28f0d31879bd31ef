"""What can be known to be wrong with a session before anything of it is opened."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from bench.contracts import (
    OPERATOR_LINK,
    AgentManifest,
    BootsFirmware,
    ChecksHost,
    HasCompanionTopics,
    LinkSpec,
    OpenVehicle,
    Vehicle,
    VehiclePlan,
    distortion_faults,
    lens_of,
    load_plugin,
    plugins,
    remedy_for,
)
from bench.errors import Fault, SetupError
from bench.perception import open_detector
from bench.simspec import DEFAULT_RENDERER, SimSpec

from ._interface import interface_address
from ._outside_air import read_token
from ._outside_links import outside_links
from ._service_relays import service_faults
from .warp import warp_fault

DISCARD_PORT = 9
"""The port of the discard service (RFC 863)."""


def session_faults(spec: SimSpec, manifest: AgentManifest) -> list[Fault]:
    """Every fault for which `run_session` would refuse this SimSpec and agent; its places are not looked at.

    Opens the vehicle for a moment, because only it knows its parameters, failures and step, the detector on pictures for
    its options, and connects to each service.
    """
    faults = [
        *link_faults(spec, manifest),
        *pace_faults(spec, manifest),
        *service_faults(spec.agent.services),
        *outside_faults(spec),
        *camera_faults(spec),
    ]
    try:
        load_plugin("rebar.scenes", spec.world.scene)
    except SetupError as error:
        faults += error.faults
    try:
        open_detector(spec, ())
    except SetupError as error:
        faults += error.faults
    # The system chooses where the vehicle listens; where it sends, nothing is sent before the first step.
    links = tuple(
        LinkSpec(
            need.name, need.kind, port=DISCARD_PORT if need.kind == "udp_out" else 0, streams=need.streams
        )
        for need in manifest.mavlink
    )
    with ExitStack() as stack:
        try:
            open_vehicle: OpenVehicle = load_plugin("rebar.vehicles", spec.vehicle.model)
            vehicle = stack.enter_context(open_vehicle(VehiclePlan(spec, links), lambda *_: None))
            faults += [
                *tick_faults(spec, vehicle),
                *firmware_faults(spec, vehicle),
                *topic_faults(spec, manifest, vehicle),
            ]
        except SetupError as error:
            faults += error.faults
    return faults


def camera_faults(spec: SimSpec) -> list[Fault]:
    """Faults of cameras that cannot be drawn: lenses, and renderers that are not installed or do not work here."""
    faults = [fault for camera in spec.vehicle.cameras for fault in distortion_faults(lens_of(camera))]
    fields = [f"vehicle.more_cameras[{index}].renderer" for index in range(len(spec.vehicle.more_cameras))]
    for field, camera in zip(("vehicle.camera.renderer", *fields), spec.vehicle.cameras, strict=True):
        # The default comes with the bench, and is not imported until somebody wants a picture.
        if camera.renderer != DEFAULT_RENDERER:
            faults += renderer_faults(field, camera.renderer)
    return faults


def renderer_faults(field: str, name: str) -> list[Fault]:
    """Why a renderer cannot draw here: it is not installed, or says so itself. `field` is what names it."""
    if name not in plugins("rebar.renderers"):
        return [Fault(field, f"there is no renderer {name!r}", remedy_for("rebar.renderers", name))]
    renderer = load_plugin("rebar.renderers", name)
    if not isinstance(renderer, ChecksHost):
        return []
    return [Fault(field, fault.what, fault.remedy) for fault in renderer.host_faults()]


def outside_faults(spec: SimSpec) -> list[Fault]:
    """Faults of what leads out of the session: interfaces and tokens that are missing."""
    faults: list[Fault] = []
    checks: list[Callable[[], object]] = [partial(outside_links, spec)]
    if air := spec.agent.outside_air:
        checks += [
            partial(read_token, air),
            partial(interface_address, air.interface, "agent.outside_air.interface"),
        ]
    for check in checks:
        try:
            check()
        except SetupError as error:
            faults += error.faults
    return faults


def link_faults(spec: SimSpec, manifest: AgentManifest) -> list[Fault]:
    """Faults where two of the vehicle's links would have one name: the agent's, the operator's, those to outside."""
    own = {need.name for need in manifest.mavlink}
    faults = []
    if OPERATOR_LINK in own:
        remedy = "give the link in the manifest another name"
        faults.append(Fault("mavlink", f"{OPERATOR_LINK!r} is the operator's link", remedy))
    for link in spec.vehicle.outside_links:
        if link.name in own | {OPERATOR_LINK}:
            owner = "the operator" if link.name == OPERATOR_LINK else "the agent"
            where = f"vehicle.outside_links[{link.name}]"
            faults.append(
                Fault(where, f"{owner} has a link of this name", "give the link to outside another")
            )
    return faults


def pace_faults(spec: SimSpec, manifest: AgentManifest) -> list[Fault]:
    """Faults if the agent, or a computer outside, cannot follow the SimSpec's pace, or the pace cannot be had here."""
    if spec.agent.outside_air and spec.pace.mode != "realtime":
        what = f"a computer outside keeps real time, and the pace is {spec.pace.mode}"
        return [Fault("agent.outside_air", what, "fly with --pace realtime")]
    if spec.pace.mode in manifest.pace:
        return _warp_faults(spec) if spec.pace.mode == "warp" else []
    possible = " or ".join(manifest.pace)
    return [
        Fault(
            "pace.mode",
            f"agent {manifest.name!r} cannot follow pace {spec.pace.mode!r}",
            f"its manifest allows {possible}: fly with --pace {manifest.pace[0]}, or write pace: {manifest.pace[0]} "
            "into the campaign",
        )
    ]


def _warp_faults(spec: SimSpec) -> list[Fault]:
    """What keeps a session from being flown in warp, whatever its vehicle."""
    fault = warp_fault()
    faults = [fault] if fault else []
    if spec.agent.services:
        what = "an agent that waits for a service outside of the session looks idle, and time would go on"
        faults.append(Fault("agent.services", what, "fly it with --pace realtime, or in lockstep"))
    return faults


def firmware_faults(spec: SimSpec, vehicle: Vehicle) -> list[Fault]:
    """A fault where a real autopilot is to be flown in warp."""
    if spec.pace.mode != "warp" or not isinstance(vehicle, BootsFirmware):
        return []
    what = "a real autopilot sends at moments of its own, for which warp cannot wait"
    return [Fault("vehicle.autopilot.firmware", what, "fly it with --pace realtime, or in lockstep")]


def topic_faults(spec: SimSpec, manifest: AgentManifest, vehicle: Vehicle) -> list[Fault]:
    """A fault if the agent wants the topics of an autopilot that this vehicle is not flown by, or that has none."""
    faults = []
    for field, release, autopilot, name in (
        ("px4_msgs", manifest.px4_msgs, "px4", "PX4"),
        ("ap_dds", manifest.ap_dds, "ardupilot", "ArduPilot"),
    ):
        if release and not (isinstance(vehicle, HasCompanionTopics) and spec.vehicle.autopilot == autopilot):
            what = f"the manifest of agent {manifest.name!r} says {field}, and this vehicle has no topics of {name}"
            remedy = f"fly it with an imitated {name} (autopilot: {autopilot}), or leave {field} out and fly by MAVLink"
            faults.append(Fault("vehicle.autopilot", what, remedy))
    return faults


def tick_faults(spec: SimSpec, vehicle: Vehicle) -> list[Fault]:
    """A fault if a tick is not a whole number of the vehicle's steps."""
    if round(spec.pace.tick_s * 1e9) % round(vehicle.step_s * 1e9) == 0:
        return []
    return [
        Fault(
            "pace.tick_s",
            f"{spec.pace.tick_s} s is not a whole number of controller steps",
            f"take a multiple of {vehicle.step_s} s",
        )
    ]

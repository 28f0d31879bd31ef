"""What the agent may know, tick by tick: the clock, the vehicle's estimated pose, then what is new."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection

from bench.contracts import (
    ConsentRequest,
    IntelligenceDocument,
    MissionOrder,
    NoFlyDocument,
    OperatorLinkDocument,
    OrderDocument,
    Origin,
    Point,
    Scene,
    SimTime,
    TimeWindow,
    Vehicle,
    VehicleState,
    escort_document,
    realized_of,
)
from bench.simspec import (
    PROTECTED_ROLES,
    TARGET_ROLES,
    Polygon,
    Role,
    SimSpec,
)
from bench.streams import (
    Clock,
    Header,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
)

from ._air_network import AirNetwork
from ._camera_messages import CameraMessages
from ._consents import OperatorConsents
from ._detection_messages import in_outage
from ._frames import base_frame, body_in_map, level_frame

# Fields of the mission order that the SimSpec has under the same names.
_AS_IN_THE_MISSION = ("kind", "altitude_m", "speed_mps", "time_limit_s", "return_home")
_AS_IN_THE_RULES = (
    *("no_mark_within_m", "min_report_confidence", "max_altitude_m", "min_altitude_m", "max_speed_mps"),
    *("bystander_standoff_m", "bystander_slow_within_m", "bystander_slow_mps", "max_loiter_over_bystander_s"),
    *("battery_reserve_fraction", "report_deadline_s", "link_lost", "link_lost_after_s", "mark_consent"),
)


class MissionInformation:
    """Publishes on the air network what is due: `/clock`, the mission, `/tf`, the operator's link,
    intelligence, orders, answers to requests for consent, in that order.
    """

    def __init__(self, simspec: SimSpec, air: AirNetwork, scene: Scene) -> None:
        self._air = air
        self._base, self._level = base_frame(simspec), level_frame(simspec)
        cameras = [CameraMessages.of(simspec, camera) for camera in simspec.vehicle.cameras]
        self._fixed = [messages for messages in cameras if not messages.camera.gimbal]
        self._turning = [messages for messages in cameras if messages.camera.gimbal]
        self._any_level = any(messages.camera.stabilized for messages in cameras)
        self._order = mission_order(simspec)
        self._intelligence = deque(sorted(intelligence(simspec), key=lambda pair: (pair[0], pair[1].id)))
        self._orders = deque(orders(simspec))
        self._consents = OperatorConsents(simspec)
        self._outages = simspec.outages
        self._link_up: bool | None = None
        self._mission_published = False
        self.deactivated = False
        """Whether the order to deactivate was delivered to the agent."""
        self._delivered: list[OrderDocument] = []

    def take_delivered(self) -> list[OrderDocument]:
        """The orders delivered since the last call."""
        delivered, self._delivered = self._delivered, []
        return delivered

    def hear(self, now: SimTime, request: ConsentRequest) -> None:
        """Bring a request for consent to the operator, who hears it only while the link is up."""
        if not in_outage(self._outages, "operator_link", now):
            self._consents.hear(now.s, request)

    def publish(self, now: SimTime, vehicle: Vehicle) -> None:
        """Publish everything that the agent may know at `now` and that was not published before."""
        air = self._air
        air.clock.publish(now, Clock(clock=Time.of(now.ns)))
        if not self._mission_published:
            self._mission_published = True
            if self._fixed:
                # In one message: the topic is latched with a depth of one.
                mounts = tuple(messages.mount(now) for messages in self._fixed)
                air.tf_static.publish(now, TFMessage(transforms=mounts))
            air.mission.publish_document(now, self._order)
        air.tf.publish(now, self._pose(now, vehicle.estimate()))
        self._publish_operator_messages(now)

    def _publish_operator_messages(self, now: SimTime) -> None:
        """Publish what the operator has sent while the link is up, reports before orders about them."""
        up = not in_outage(self._outages, "operator_link", now)
        if up is not self._link_up:
            self._link_up = up
            self._air.operator_link.publish_document(now, OperatorLinkDocument(up=up))
        while up and self._intelligence and self._intelligence[0][0] <= now.s:
            self._air.intelligence.publish_document(now, self._intelligence.popleft()[1])
        while up and self._orders and self._orders[0].issued_s <= now.s:
            order = self._orders.popleft()
            self._air.orders.publish_document(now, order)
            self.deactivated |= order.kind == "deactivate"
            self._delivered.append(order)
        if up:
            for answer in self._consents.due(now.s):
                self._air.consents.publish_document(now, answer)

    def _pose(self, now: SimTime, state: VehicleState) -> TFMessage:
        east, north, up = state.position_enu_m
        header, translation = Header(stamp=Time.of(now.ns), frame_id="map"), Vector3(x=east, y=north, z=up)
        transform = Transform(
            translation=translation, rotation=body_in_map(state.roll_rad, state.pitch_rad, state.yaw_rad)
        )
        poses: tuple[TransformStamped, ...] = (
            TransformStamped(header=header, child_frame_id=self._base, transform=transform),
        )
        if self._any_level:
            level = Transform(translation=translation, rotation=body_in_map(0.0, 0.0, state.yaw_rad))
            poses = (*poses, TransformStamped(header=header, child_frame_id=self._level, transform=level))
        mounts = (messages.mount(now, state) for messages in self._turning)
        return TFMessage(transforms=(*poses, *mounts))


def mission_order(simspec: SimSpec) -> MissionOrder:
    """The mission and rules of the SimSpec as the agent gets them; of the actors, only their classes."""

    def classes(roles: Collection[Role]) -> tuple[str, ...]:
        return tuple(
            sorted({group.definition.class_label for group in simspec.actors if group.role in roles})
        )

    def corners(polygon: Polygon) -> tuple[Point, ...]:
        return tuple(Point(corner.east_m, corner.north_m) for corner in polygon.corners)

    origin, home = simspec.world.origin, simspec.vehicle.home
    mission, rules = simspec.mission, simspec.rules
    return MissionOrder(
        origin=Origin(origin.latitude_deg, origin.longitude_deg, origin.altitude_m),
        area=corners(simspec.world.area),
        home=Point(home.east_m, home.north_m),
        geofence=None if rules.geofence is None else corners(rules.geofence),
        no_fly=tuple(
            NoFlyDocument(area.id, corners(area.area), area.from_s, area.until_s) for area in rules.no_fly
        ),
        report_windows=tuple(TimeWindow(window.from_s, window.until_s) for window in rules.report_windows),
        escort=escort_document(simspec),
        target_classes=classes(TARGET_ROLES),
        bystander_classes=classes(PROTECTED_ROLES) or ("civilian",),
        **{name: getattr(mission, name) for name in _AS_IN_THE_MISSION},
        **{name: getattr(rules, name) for name in _AS_IN_THE_RULES},
    )


def intelligence(simspec: SimSpec) -> list[tuple[float, IntelligenceDocument]]:
    """Every intelligence report of a realized SimSpec, with its time of delivery in seconds."""
    places = {report.id: report for report in realized_of(simspec).reports}
    return [
        (
            report.delivered_s,
            IntelligenceDocument(
                id=report.id,
                class_label=simspec.group(report.about).definition.class_label,
                east_m=places[report.id].east_m,
                north_m=places[report.id].north_m,
                uncertainty_m=report.uncertainty_m,
                priority=report.priority,
                observed_s=report.delivered_s - report.latency_s,
            ),
        )
        for report in simspec.intelligence
    ]


def orders(simspec: SimSpec) -> list[OrderDocument]:
    """Every order of the operator, in the order of time and, within a moment, as the SimSpec lists them."""
    return [
        OrderDocument(
            id=order.id,
            kind=order.kind,
            issued_s=order.at_s,
            within_s=order.within_s,
            intelligence_id=order.intelligence,
        )
        for order in sorted(simspec.orders, key=lambda order: order.at_s)
    ]

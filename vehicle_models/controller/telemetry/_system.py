"""Messages about the state of the autopilot itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from ..links._frames import hundredths
from ..links._radio import Channel
from ..policies._identity import IdentityPolicy
from ..policies._modes import ModePolicy
from ..policies._telemetry import TelemetryPolicy
from ..state._service import ChannelStream, Stream, Values
from ..state._service_context import ServiceContext
from ._battery_monitor import BatteryMonitor

# Of HEARTBEAT; it did not change with MAVLink 2.
_MAVLINK_VERSION = 3
# MAV_SYS_STATUS_SENSOR
_GPS, _XY_POSITION_CONTROL = 0x20, 0x4000
_ESTIMATOR_OK = 1023
# ESTIMATOR_STATUS_FLAGS: horizontal position, and its prediction.
_ESTIMATOR_BY_GPS = 8 | 16 | 256 | 512
_NAN = math.nan


class SystemTelemetry:
    """Values in wire order."""

    def __init__(
        self,
        context: ServiceContext,
        policy: TelemetryPolicy,
        identity: IdentityPolicy,
        modes: ModePolicy,
        battery: BatteryMonitor,
        has_setpoints: Callable[[], bool],
    ) -> None:
        self._flight = context.flight
        self._policy = policy
        self._identity = identity
        self._modes = modes
        self._battery = battery
        self._has_setpoints = has_setpoints

    def streams(self) -> Mapping[str, Stream | ChannelStream]:
        f, policy = self._flight, self._policy
        return {
            "HEARTBEAT": self._heartbeat,
            "CURRENT_MODE": self._current_mode,
            "SYS_STATUS": self._status,
            "EXTENDED_SYS_STATE": lambda: (policy.vtol_state, int(f.landed)),
            "SYSTEM_TIME": lambda: (f.unix_start_us + f.time_us, f.time_ms),
            "ESTIMATOR_STATUS": self._estimator,
            "EKF_STATUS_REPORT": lambda: (0.0, 0.0, 0.0, 0.0, 0.0, policy.estimator_flags(f), 0.0),
            "VIBRATION": lambda: (f.time_us, 0.0, 0.0, 0.0, 0, 0, 0),
            "MEMINFO": lambda: (0, 65535, 131072),
            "LINK_NODE_STATUS": ChannelStream(self._link),
        }

    def _heartbeat(self) -> Values:
        flight, identity = self._flight, self._identity
        base, status = self._modes.heartbeat(flight, self._has_setpoints())
        return (flight.mode.custom, identity.vehicle_type, identity.autopilot, base, status, _MAVLINK_VERSION)

    def _current_mode(self) -> Values:
        mode = self._flight.mode
        asked = self._flight.asked_mode or mode
        return (mode.custom, asked.custom, self._modes.standard_modes.get(mode.name, 0))

    def _status(self) -> Values:
        f = self._flight
        bits = self._policy.sensors(f)
        # Without fixes the position is continued by dead reckoning, and only then control by it is lost.
        lost = 0 if f.gps_ok else _GPS if f.position_ok else _GPS | _XY_POSITION_CONTROL
        battery = (self._policy.load_permille, self._battery.millivolts(), hundredths(f.battery_a))
        percent = round(100.0 * f.battery_fraction)
        return (bits.present, bits.enabled, bits.health & ~lost, *battery, 0, 0, 0, 0, 0, 0, percent, 0, 0, 0)

    def _estimator(self) -> Values:
        f = self._flight
        flags = (_ESTIMATOR_OK if f.position_ok else _ESTIMATOR_OK & ~_ESTIMATOR_BY_GPS) if f.home else 0
        return (f.time_us, 0.01, 0.02, 0.02, _NAN, 0.0, _NAN, 0.3, 0.3, flags)

    def _link(self, channel: Channel) -> Values:
        """Counts of the link that the message goes over; rates and buffers are not measured."""
        link = channel.link
        return (self._flight.time_ms, 0, 0, link.sent, link.received, 0, 0, 0, 0, 0, 0)

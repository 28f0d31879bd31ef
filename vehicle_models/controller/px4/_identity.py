"""PX4's version, its texts, and the events that go with them."""

from __future__ import annotations

from ..files._metadata import Metadata
from ..links._enums import MAV_AUTOPILOT
from ..policies._choices import choices
from ..policies._identity import CalibrationProtocol, IdentityPolicy
from ..state._event_names import EventName
from ..state._texts import CRITICAL, INFO, FlightEvent
from ._parameters import PARAMETERS

# The beginning of a text, and the event that goes with it. The names imitate PX4's; the file that we serve as
# metadata explains exactly these.
EVENTS = tuple(
    EventName(text, name)
    for text, name in (
        ("Armed by external command", "commander_armed_by"),
        ("Disarmed by external command", "commander_disarmed_by"),
        ("Disarmed by landing", "commander_disarmed_by_landing"),
        ("Disarmed by auto preflight disarming", "commander_disarmed_by_preflight"),
        ("Disarmed by failure detector", "commander_disarmed_by_failure"),
        ("Arming denied", "commander_arming_denied"),
        ("Disarming denied", "commander_disarming_denied_not_landed"),
        ("Using default takeoff altitude", "navigator_default_takeoff_alt"),
        ("Using minimum takeoff altitude", "navigator_takeoff_min_alt"),
        ("Already higher than takeoff altitude", "navigator_takeoff_already_higher"),
        ("Takeoff detected", "commander_takeoff_detected"),
        ("Landing detected", "commander_landing_detected"),
        ("Landing at current position", "navigator_landing_current_position"),
        ("Returning to launch", "commander_rtl"),
        ("RTL: start return at", "vrtl_return_at"),
        ("RTL: land at destination", "rtl_land_at_destination"),
        ("Failsafe activated", "commander_failsafe_enter"),
        ("Connection to ground station lost", "commander_gcs_lost"),
        ("First waypoint too far away", "navigator_mis_first_wp_far"),
        ("Low battery", "commander_low_battery"),
        ("Critical battery", "commander_critical_battery"),
        ("Emergency battery level", "commander_emergency_battery"),
        ("Switching to", "commander_mode_not_available"),
        ("Unsupported auto mode", "commander_unsupported_auto_mode"),
        ("Mission start denied", "commander_mission_start_denied"),
        ("Mission finished", "navigator_mission_finished"),
        ("Executing Mission", "navigator_executing_mission"),
        ("Reposition is outside geofence", "navigator_reposition_outside_geofence"),
        ("Geofence: exceeding maximum distance", "check_gf_violation_max_hor_dist"),
        ("Geofence: exceeding maximum altitude", "check_gf_violation_max_alt"),
        ("Geofence: approaching or outside", "check_gf_violation_custom_gf"),
        ("Pilot took over", "commander_rc_override"),
        ("Orbit radius limit exceeded", "navigator_orbit_radius_exceeded"),
    )
)

IDENTITY = IdentityPolicy(
    **choices(IdentityPolicy, "px4"),
    name="px4",
    autopilot=MAV_AUTOPILOT.PX4,
    flight_custom_version=b"\0" * 8,
    protocol_versions=(200, 100, 203),
    texts={
        FlightEvent.ARMED: (INFO, "Armed by external command"),
        FlightEvent.DISARMED: (INFO, "Disarmed by external command"),
        FlightEvent.DISARMED_BY_LANDING: (INFO, "Disarmed by landing"),
        FlightEvent.DISARMED_IDLE: (INFO, "Disarmed by auto preflight disarming"),
        FlightEvent.TAKEOFF_DEFAULT: (INFO, "Using default takeoff altitude: {:.1f} m"),
        # As PX4's source has these two; they were not observed.
        FlightEvent.TAKEOFF_RAISED: (CRITICAL, "Using minimum takeoff altitude: {:.2f} m"),
        FlightEvent.TAKEOFF_BELOW: (CRITICAL, "Already higher than takeoff altitude"),
        FlightEvent.TAKEOFF_DETECTED: (INFO, "Takeoff detected"),
        FlightEvent.LANDING_DETECTED: (INFO, "Landing detected"),
        FlightEvent.LANDING: (INFO, "Landing at current position"),
        FlightEvent.RETURNING: (INFO, "Returning to launch"),
        FlightEvent.RETURN_BEGINS: (INFO, "RTL: start return at {:.0f} m ({:.0f} m above destination)"),
        FlightEvent.RETURN_LANDS: (INFO, "RTL: land at destination"),
        FlightEvent.PILOT_TOOK_OVER: (INFO, "Pilot took over using sticks"),
        FlightEvent.TERMINATED: (CRITICAL, "Preflight Fail: Flight termination active"),
        FlightEvent.CRASHED: (CRITICAL, "Disarmed by failure detector"),
    },
    text_ending="\t",
    event_names=EVENTS,
    metadata=Metadata(PARAMETERS.definitions, EVENTS),
    folders=("log",),
    calibration=CalibrationProtocol.TEXTS,
)

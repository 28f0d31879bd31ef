"""Who PX4 says it is, in data: standard modes, and the events that go with its texts."""

from __future__ import annotations

from ..telemetry._event_names import EventName

# MAV_STANDARD_MODE by mode.
STANDARD_MODES = {
    "POSCTL": 1,
    "POSCTL_ORBIT": 2,
    "ALTITUDE_CRUISE": 3,
    "ALTCTL": 4,
    "AUTO_RTL": 5,
    "AUTO_MISSION": 6,
    "AUTO_LAND": 7,
    "AUTO_TAKEOFF": 8,
}

# The beginning of a text, and the event that goes with it. Names in the manner of PX4's; the file that we serve as
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
        ("Takeoff detected", "commander_takeoff_detected"),
        ("Landing detected", "commander_landing_detected"),
        ("Landing at current position", "navigator_landing_current_position"),
        ("Returning to launch", "commander_rtl"),
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

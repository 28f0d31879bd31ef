"""Modes that a companion registers at a PX4: registration, arming checks, setpoints, the fallback, completion."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from random import Random
from typing import Any

import pytest
from test_vehicle_px4_topics import (
    ACCEPTED,
    DENIED,
    HOLD,
    LAND,
    OPEN,
    REJECTED,
    RETURN,
    Build,
    Companion,
    build,
)
from vehicle_client import NAN, Client, Make, mavlink, of, simspec

from vehicle_models import open_wing, open_x500
from vehicle_models.controller.px4._external_modes import _Registration

__all__ = ["build"]

EXTERNAL1, TAKEOFF = 23, 17
SET_NAV_STATE, SET_MODE, ARM, LAND_NOW = 100001, 176, 400, 21
NEEDS = (
    *("angular_velocity", "attitude", "local_alt", "local_position", "local_position_relaxed"),
    *("global_position", "global_position_relaxed", "mission", "home_position", "prevent_arming"),
    "manual_control",
)
FLAGS = ("position", "velocity", "acceleration", "attitude", "rates")


def name(text: str) -> tuple[int, ...]:
    return tuple(text.encode().ljust(25, b"\0"))


class Mode:
    """A companion's program with one mode, which answers arming checks as long as it is `alive`."""

    def __init__(self, companion: Companion, text: str = "Square", **reply: bool) -> None:
        self.companion, self.text, self.reply = companion, text, reply
        self.alive, self.read = True, 0
        self.check = self.nav_state = -1

    def register(self, **more: Any) -> Any:
        """Ask, let one step pass, and return the reply."""
        request = {
            "request_id": 77,
            "name": name(self.text),
            "px4_ros2_api_version": 1,
            "register_arming_check": True,
            "register_mode": True,
            "register_mode_executor": False,
            "enable_replace_internal_mode": False,
            "replace_internal_mode": 0,
            "activate_mode_immediately": False,
            **more,
        }
        begun = len(self.companion.heard)
        self.companion.send("register_ext_component_request", **request)
        self.companion.fly(0.02)
        heard = self.companion.heard[begun:]
        (reply,) = [fields for _, topic, fields in heard if topic == "register_ext_component_reply"]
        assert (reply["request_id"], reply["name"]) == (77, name(self.text))
        self.check, self.nav_state = reply["arming_check_id"], reply["mode_id"]
        return reply

    def answer(self, request_id: int | None = None, **reply: bool) -> None:
        given = {"can_arm_and_run": True, **self.reply, **reply}
        needs = {f"mode_req_{need}": given.get(f"mode_req_{need}", False) for need in NEEDS}
        if request_id is None:
            request_id = self.companion.last("arming_check_request")["request_id"]
        more = {"can_arm_and_run": given["can_arm_and_run"], "num_events": 0}
        self.companion.send(
            "arming_check_reply", request_id=request_id, registration_id=self.check, **more, **needs
        )

    def unregister(self) -> None:
        ids = {"arming_check_id": self.check, "mode_id": self.nav_state, "mode_executor_id": -1}
        self.companion.send("unregister_ext_component", name=name(self.text), **ids)

    def fly(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """Answer each request in the step after it."""
        heard = self.companion.heard
        for _ in range(round(seconds * 50)):
            new, self.read = heard[self.read :], len(heard)
            if self.alive and any(topic == "arming_check_request" for _, topic, _ in new):
                self.answer()
            if each:
                each()
            self.companion.fly(0.02)

    def takes_off(self) -> None:
        """At 5 m in the mode, by its setpoints and without any sign of life of the offboard mode."""
        self.fly(5.0)
        assert self.companion.command(SET_NAV_STATE, float(self.nav_state)) == [ACCEPTED]
        self.fly(0.1)
        assert self.companion.command(ARM, 1.0) == [ACCEPTED]
        self.fly(12.0, lambda: self.companion.trajectory((0.0, 0.0, -5.0)))
        assert self.companion.vehicle.truth().position_enu_m[2] == pytest.approx(5.0, abs=0.1)
        assert self.companion.state() == (self.nav_state, self.nav_state, False)


@pytest.fixture
def mode(build: Build) -> Mode:
    """Registered, on the ground."""
    mode = Mode(build())
    reply = mode.register()
    assert (reply["success"], reply["mode_id"], reply["arming_check_id"]) == (True, EXTERNAL1, 0)
    return mode


@pytest.fixture
def flying(mode: Mode) -> Mode:
    mode.takes_off()
    return mode


def test_a_mode_is_flown_by_its_setpoints_until_it_leaves(flying: Mode) -> None:
    """Nothing of the offboard mode is needed; a mode that leaves in flight holds, and cannot be chosen any more."""
    mode, companion = flying, flying.companion
    control = companion.last("vehicle_control_mode")
    assert control["flag_control_position_enabled"]
    assert not control["flag_control_offboard_enabled"]
    assert not control["flag_control_auto_enabled"]
    # Setpoints of another kind, and kinds of another mode, are not flown.
    rates = {"roll": 1.0, "pitch": 0.0, "yaw": 0.0, "thrust_body": (0.0, 0.0, -0.9)}
    companion.send("vehicle_rates_setpoint", **rates)
    companion.send("config_control_setpoints", source_id=EXTERNAL1 + 1, **dict.fromkeys(FLAGS, True))
    mode.fly(2.0)
    assert companion.vehicle.counters()["setpoints_ignored"] == 2
    assert companion.vehicle.truth().position_enu_m[2] == pytest.approx(5.0, abs=0.1)
    mode.fly(8.0, lambda: companion.trajectory((4.0, 0.0, -5.0)))
    east, north, _ = companion.vehicle.truth().position_enu_m
    assert (north, east) == pytest.approx((4.0, 0.0), abs=0.3)
    # A type of 1.18 is flown once it is applied.
    for applied in (False, True):
        companion.send("setpoint_config", type=6, source_id=EXTERNAL1, timeout_ms=0, should_apply=applied)
        mode.fly(0.04)
        assert companion.last("vehicle_control_mode")["flag_control_position_enabled"] is not applied
        assert companion.last("vehicle_control_mode")["flag_control_attitude_enabled"]
    mode.unregister()
    companion.fly(0.04)
    assert companion.state() == (HOLD, HOLD, False)
    assert companion.command(SET_NAV_STATE, float(EXTERNAL1)) == [REJECTED]
    assert not companion.last("vehicle_status")["can_set_nav_states_mask"] >> EXTERNAL1 & 1


def test_the_same_setpoints_fly_as_in_the_offboard_mode(build: Build) -> None:
    """Random trajectories, attitudes and rates, bit for bit; the level comes from config_control_setpoints."""
    random = Random(5)
    offboard, external = build(), build()
    mode = Mode(external)
    external.fly(1.0)
    mode.register()
    mode.fly(4.5)
    offboard.fly(5.52)
    mode.fly(round(offboard.vehicle.time.s - external.vehicle.time.s, 3))
    for companion in (offboard, external):
        assert companion.command(ARM, 1.0) == [ACCEPTED]
        companion.post(22, 0.0, 0.0, 0.0, NAN, NAN, NAN, 508.0)
    for _ in range(round(15.0 * 50)):
        mode.fly(0.02)
        offboard.fly(0.02)
    offboard.life("position")
    assert offboard.command(SET_MODE, 1.0, 6.0) == [ACCEPTED]
    assert external.command(SET_MODE, 1.0, 4.0, 11.0) == [ACCEPTED]
    for _ in range(12):
        level = random.choice(FLAGS)
        flags = {f"flag_control_{flag}_enabled": FLAGS.index(flag) >= FLAGS.index(level) for flag in FLAGS}
        external.send("config_control_setpoints", source_id=EXTERNAL1, **flags)
        vector = tuple(random.uniform(-2.0, 2.0) for _ in range(3))
        thrust = (0.0, 0.0, -random.uniform(0.4, 0.6))
        tilt = random.uniform(-0.1, 0.1)
        for _ in range(10):
            offboard.life("body_rate" if level == "rates" else level)
            for companion in (offboard, external):
                if level == "attitude":
                    turned = {
                        "q_d": (math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0),
                        "yaw_sp_move_rate": NAN,
                    }
                    companion.send("vehicle_attitude_setpoint", thrust_body=thrust, **turned)
                elif level == "rates":
                    rates = {"roll": tilt, "pitch": 0.0, "yaw": tilt}
                    companion.send("vehicle_rates_setpoint", thrust_body=thrust, **rates)
                else:
                    position = (vector[0], vector[1], vector[2] - 20.0) if level == "position" else OPEN
                    companion.trajectory(position, velocity=vector)
            offboard.fly(0.02)
            mode.fly(0.02)
            assert offboard.vehicle.truth() == external.vehicle.truth()
    assert external.state()[1] == EXTERNAL1
    assert external.vehicle.counters()["setpoints_ignored"] == 0


def test_a_goto_setpoint_is_flown_within_its_limits(flying: Mode) -> None:
    """To the place, with the heading, and no faster than asked; without limits it is faster."""
    mode, companion, random = flying, flying.companion, Random(1)
    fastest = {}
    for limited in (True, False):
        x, y, z = random.uniform(8.0, 12.0), random.uniform(-12.0, -8.0), -random.uniform(8.0, 9.0)
        place = (x, y, z) if limited else (x - 20.0, y + 20.0, z)
        heading = random.uniform(-3.0, 3.0)
        goto = {
            "position": place,
            "flag_control_heading": True,
            "heading": heading,
            "flag_set_max_horizontal_speed": limited,
            "max_horizontal_speed": 1.2,
            "flag_set_max_vertical_speed": limited,
            "max_vertical_speed": 0.5,
            "flag_set_max_heading_rate": False,
            "max_heading_rate": 0.0,
        }
        begun = len(companion.heard)
        companion.send("goto_setpoint", **goto)
        mode.fly(35.0)
        moves = [fields for _, topic, fields in companion.heard[begun:] if topic == "vehicle_local_position"]
        fastest[limited] = max(math.hypot(move["vx"], move["vy"]) for move in moves)
        assert (moves[-1]["x"], moves[-1]["y"], moves[-1]["z"]) == pytest.approx(place, abs=0.5)
        assert math.cos(moves[-1]["heading"] - heading) == pytest.approx(1.0, abs=0.01)
    assert fastest[True] == pytest.approx(1.2, abs=0.2)
    assert fastest[False] > fastest[True] + 0.5
    wrong = {"max_horizontal_speed": -1.0, "flag_set_max_horizontal_speed": True}
    for nonsense in ({"position": (NAN, 0.0, 0.0)}, wrong):
        companion.send("goto_setpoint", **{**goto, **nonsense})
    mode.fly(0.1)
    assert companion.vehicle.counters()["setpoints_ignored"] == 2


def test_requests_come_every_0_3_s_with_the_mask_of_those_that_answer(build: Build) -> None:
    companion = build()
    companion.fly(1.0)
    assert companion.times("arming_check_request") == []
    first, second = Mode(companion, "First"), Mode(companion, "Second")
    assert first.register()["mode_id"] == EXTERNAL1
    second.register()
    second.alive = False
    assert (second.check, second.nav_state) == (1, EXTERNAL1 + 1)
    first.fly(6.0)
    times = companion.times("arming_check_request")
    # The first step that is more than 0.3 s behind the last request.
    assert {round(later - sooner, 3) for sooner, later in pairwise(times)} == {0.32}
    requests = [fields for _, topic, fields in companion.heard if topic == "arming_check_request"]
    assert [request["request_id"] for request in requests[:3]] == [1, 2, 3]
    # As in PX4 the second, which came after the first request, has missed that too. After the eleventh it is taken out,
    # because nobody has chosen it.
    masks = [request["valid_registrations_mask"] for request in requests]
    assert masks[0] == 1
    assert masks[1:11] == [3] * 10
    assert set(masks[11:]) == {1}
    assert companion.last("vehicle_status")["can_set_nav_states_mask"] >> EXTERNAL1 & 3 == 1


@pytest.mark.parametrize(("missed", "returns"), [(3, False), (4, True)])
def test_a_mode_whose_replies_stop_returns_home_and_resumes_with_the_next(
    missed: int, returns: bool, flying: Mode
) -> None:
    """Three requests without a reply are borne; after the fourth it cannot run."""
    mode, companion = flying, flying.companion
    companion.trajectory((3.0, 0.0, -5.0))
    mode.fly(6.0)
    begun = len(companion.times("arming_check_request"))
    mode.alive = False
    while len(companion.times("arming_check_request")) < begun + missed:
        mode.fly(0.02)
    mode.fly(0.08)  # what is missing is counted 0.05 s after a request
    assert companion.state() == ((EXTERNAL1, RETURN, True) if returns else (EXTERNAL1, EXTERNAL1, False))
    assert bool(companion.last("failsafe_flags")["mode_req_other"] >> EXTERNAL1 & 1) is returns
    mode.alive = True
    mode.answer()
    mode.fly(0.5)
    assert companion.state() == (EXTERNAL1, EXTERNAL1, False)
    mode.fly(6.0)
    assert companion.vehicle.truth().position_enu_m[1] == pytest.approx(3.0, abs=0.3)


def test_a_lost_mode_lands_at_home_and_is_forgotten_when_it_is_not_chosen_any_more(flying: Mode) -> None:
    mode, companion = flying, flying.companion
    mode.alive = False
    mode.fly(60.0)
    status = companion.last("vehicle_status")
    assert (status["arming_state"], status["nav_state"]) == (1, HOLD)
    assert not status["can_set_nav_states_mask"] >> EXTERNAL1 & 1
    completed = [fields["nav_state"] for _, topic, fields in companion.heard if topic == "mode_completed"]
    assert completed == [RETURN]
    # The same name has the same number again, another one the next.
    assert Mode(companion, "Other").register()["mode_id"] == EXTERNAL1 + 1
    assert mode.register()["mode_id"] == EXTERNAL1


def test_after_four_failures_a_reply_helps_no_more() -> None:
    registration = _Registration(name("a"), "a", None, -1, True)
    reply = {"can_arm_and_run": True}
    for failure in range(1, 5):
        while not registration.unresponsive:
            registration.replied = False
            registration.count_missing()
        registration.take_reply(reply)
        assert registration.unresponsive is (failure == 4)


def test_a_reply_to_another_request_counts_as_none(mode: Mode) -> None:
    companion = mode.companion
    mode.alive = False
    companion.fly(5.0)
    mode.answer(companion.last("arming_check_request")["request_id"] - 1)
    companion.fly(0.02)
    assert companion.vehicle.counters()["setpoints_ignored"] == 1
    assert not companion.last("vehicle_status")["can_set_nav_states_mask"] >> EXTERNAL1 & 1


@pytest.mark.parametrize("need", ["", *NEEDS])
def test_what_a_mode_needs_decides_about_arming(need: str, mode: Mode) -> None:
    """Before the position is known nothing that needs one; without sticks or a mission nothing that needs those."""
    companion = mode.companion
    if need:
        mode.reply[f"mode_req_{need}"] = True
    mode.fly(1.0)
    assert companion.command(SET_NAV_STATE, float(EXTERNAL1)) == [ACCEPTED]
    mode.fly(4.5)
    expected = need not in ("mission", "manual_control", "prevent_arming")
    assert companion.last("vehicle_status")["pre_flight_checks_pass"] is expected
    if need:
        assert companion.last("failsafe_flags")[f"mode_req_{need}"] >> EXTERNAL1 & 1
    assert companion.command(ARM, 1.0) == [ACCEPTED if expected else REJECTED]


def test_a_mode_that_says_no_cannot_be_armed_nor_chosen_in_flight(build: Build) -> None:
    companion = build()
    mode = Mode(companion, can_arm_and_run=False)
    mode.register()
    mode.fly(5.0)
    assert companion.command(ARM, 1.0) == [ACCEPTED]
    assert companion.command(22, 0.0, 0.0, 0.0, NAN, NAN, NAN, 508.0) == [ACCEPTED]
    mode.fly(12.0)
    assert companion.command(SET_NAV_STATE, float(EXTERNAL1)) == [REJECTED]
    mode.reply["can_arm_and_run"] = True
    mode.fly(0.5)
    assert companion.command(SET_NAV_STATE, float(EXTERNAL1)) == [ACCEPTED]
    mode.reply["can_arm_and_run"] = False
    mode.fly(0.5)
    assert companion.state() == (EXTERNAL1, RETURN, True)


def test_a_check_without_a_mode_keeps_the_vehicle_on_the_ground(build: Build) -> None:
    """In every mode, until it agrees or has fallen silent."""
    companion = build()
    check = Mode(companion, can_arm_and_run=False)
    reply = check.register(register_mode=False)
    assert (reply["success"], reply["arming_check_id"], reply["mode_id"]) == (True, 0, -1)
    check.fly(5.0)
    assert companion.command(ARM, 1.0) == [REJECTED]
    check.reply["can_arm_and_run"] = True
    check.fly(0.5)
    assert companion.command(ARM, 1.0) == [ACCEPTED]
    assert companion.command(ARM, 0.0) == [ACCEPTED]
    check.reply["can_arm_and_run"] = False
    check.fly(0.5)
    assert not companion.last("vehicle_status")["pre_flight_checks_pass"]
    check.alive = False
    check.fly(2.0)
    assert companion.last("vehicle_status")["pre_flight_checks_pass"]


def test_what_cannot_be_registered_is_refused(build: Build) -> None:
    companion = build()
    for wrong in (
        {"register_mode_executor": True},
        {"enable_replace_internal_mode": True, "replace_internal_mode": RETURN},
        {"register_arming_check": False},
    ):
        reply = Mode(companion).register(**wrong)
        assert not reply["success"], wrong
        assert (reply["arming_check_id"], reply["mode_id"], reply["mode_executor_id"]) == (-1, -1, -1)
    companion.fly(1.0)
    assert companion.times("arming_check_request") == []


def test_eight_modes_and_no_ninth(build: Build) -> None:
    companion = build()
    replies = [Mode(companion, f"Mode {number}").register() for number in range(9)]
    assert [reply["mode_id"] for reply in replies] == [*range(EXTERNAL1, EXTERNAL1 + 8), -1]
    assert [reply["success"] for reply in replies] == [True] * 8 + [False]


def test_the_autopilot_states_its_own_api_version_whatever_the_companion_says(build: Build) -> None:
    """So that a library of another version ends itself; the version is that of the layout in use."""
    companion = build()
    assert Mode(companion).register(px4_ros2_api_version=2)["px4_ros2_api_version"] == 1
    newer = {"px4_ros2_api_version": 1, "not_user_selectable": True, "request_offboard_setpoints": False}
    reply = Mode(companion, "Other").register(**newer)
    assert (reply["px4_ros2_api_version"], reply["not_user_selectable"]) == (2, True)


@pytest.mark.parametrize("allowed", [0, 1])
def test_in_flight_com_mode_arm_chk_decides_who_comes_and_goes(allowed: int, build: Build) -> None:
    companion = build(simspec(vehicle={"parameters": {"COM_MODE_ARM_CHK": allowed}}))
    mode = Mode(companion)
    mode.register()
    mode.takes_off()
    assert Mode(companion, "Late").register()["success"] is bool(allowed)
    mode.unregister()
    mode.fly(0.1)
    assert companion.state()[1] == (HOLD if allowed else EXTERNAL1)


def test_another_name_cannot_unregister_a_mode(mode: Mode) -> None:
    companion = mode.companion
    mode.fly(1.0)
    for text, nav_state in (("Circle", EXTERNAL1), ("Square", EXTERNAL1 + 1)):
        other = Mode(companion, text)
        other.check, other.nav_state = mode.check, nav_state
        other.unregister()
    mode.fly(0.5)
    assert companion.last("vehicle_status")["can_set_nav_states_mask"] >> EXTERNAL1 & 1
    mode.unregister()
    mode.fly(0.5)
    assert not companion.last("vehicle_status")["can_set_nav_states_mask"] >> EXTERNAL1 & 1


SUCCESS, FAILURE, UNSUPPORTED_TYPE, UNKNOWN_TYPE = range(4)


@pytest.mark.parametrize(("opened", "goto"), [(open_x500, (SUCCESS, 4)), (open_wing, (UNSUPPORTED_TYPE, 0))])
def test_a_setpoint_type_of_1_18_is_answered_with_what_it_needs(
    build: Build, opened: Any, goto: tuple[int, int]
) -> None:
    """Asked for only, it changes nothing; a wing flies no goto."""
    companion = build(opened=opened)
    Mode(companion).register()
    for kind, (result, need_count) in {
        **dict.fromkeys((0, 17), (UNKNOWN_TYPE, 0)),
        **dict.fromkeys((1, 3, 16), (UNSUPPORTED_TYPE, 0)),
        2: goto,
        4: (SUCCESS, 4),
        5: (SUCCESS, 1),
        6: (SUCCESS, 2),
    }.items():
        config = {"type": kind, "should_apply": False, "timeout_ms": 0}
        companion.send("setpoint_config", source_id=EXTERNAL1, **config)
        companion.fly(0.02)
        reply = companion.last("setpoint_config_reply")
        assert (reply["type"], reply["source_id"], reply["result"]) == (kind, EXTERNAL1, result)
        asked_for = [bool(reply.get(f"mode_req_{need}")) for need in NEEDS[:4]]
        assert asked_for == [index < need_count for index in range(4)]
        companion.send("setpoint_config", source_id=EXTERNAL1 + 1, **config)
        companion.fly(0.02)
        assert companion.last("setpoint_config_reply")["result"] == (result or FAILURE)


def test_completed_modes_are_told_on_the_way_out(mode: Mode) -> None:
    """The companion's own as an echo; takeoff and landing by themselves, and no mode that was left before its end."""
    companion = mode.companion
    mode.fly(5.0)
    takeoff = (22, 0.0, 0.0, 0.0, NAN, NAN, NAN, 508.0)

    def completed() -> list[tuple[int, int]]:
        told = [fields for _, topic, fields in companion.heard if topic == "mode_completed"]
        return [(fields["nav_state"], fields["result"]) for fields in told]

    assert companion.command(ARM, 1.0) == [ACCEPTED]
    assert companion.command(*takeoff) == [ACCEPTED]
    mode.fly(1.0)
    assert companion.command(SET_NAV_STATE, float(HOLD)) == [ACCEPTED]
    mode.fly(1.0)
    assert completed() == []
    assert companion.command(*takeoff) == [ACCEPTED]
    mode.fly(20.0)
    assert completed() == [(TAKEOFF, 0)]
    assert companion.command(SET_NAV_STATE, float(EXTERNAL1)) == [ACCEPTED]
    companion.send("mode_completed", nav_state=EXTERNAL1, result=100)
    mode.fly(1.0)
    # PX4 leaves a completed mode to whoever has chosen it.
    assert companion.state()[1] == EXTERNAL1
    assert companion.command(LAND_NOW) == [ACCEPTED]
    mode.fly(40.0)
    assert completed() == [(TAKEOFF, 0), (EXTERNAL1, 100), (LAND, 0)]
    assert companion.last("vehicle_status")["arming_state"] == 1


def test_the_links_know_registered_modes_and_fly_them(make: Make) -> None:
    """AVAILABLE_MODES names them, DO_SET_MODE enters them in flight; setpoints of the links are not theirs."""
    client: Client = make(companion_topics=True)
    companion = Companion(client.vehicle)
    mode = Mode(companion)
    hidden = Mode(companion, "Hidd\x07en")
    mode.register()
    newer = {"not_user_selectable": True, "request_offboard_setpoints": False}
    hidden.register(**newer)
    mode.fly(0.5)
    assert client.command(512, 435.0, 0.0) == [ACCEPTED]
    client.fly(1.0)
    automatic = [m for m in of("AVAILABLE_MODES", client.received) if m.custom_mode >> 16 & 255 == 4]
    shown = {m.custom_mode >> 24: (m.mode_name, m.properties) for m in automatic}
    assert [shown[sub] for sub in (11, 12, 13)] == [("Square", 0), ("Hidden", 2), ("(Mode not available)", 2)]
    mode.fly(5.0)
    assert client.command(400, 1.0) == [ACCEPTED]
    assert client.command(22, 0.0, 0.0, 0.0, NAN, NAN, NAN, 508.0) == [ACCEPTED]
    mode.fly(14.0)
    assert client.command(176, 1.0, 4.0, 13.0) == [ACCEPTED, REJECTED]
    assert client.command(176, 1.0, 4.0, 11.0) == [ACCEPTED] * 2
    mode.fly(0.02)
    assert companion.state()[1] == EXTERNAL1
    companion.trajectory((2.0, 0.0, -20.0))
    mode.fly(6.0)
    message = mavlink.MAVLink_set_position_target_local_ned_message
    client.send(message(0, 1, 1, 1, 0xDF8, 9.0, 0.0, -9.0, *(0.0,) * 8))
    client.fly(0.02)
    mode.fly(4.0)
    assert client.vehicle.truth().position_enu_m == pytest.approx((0.0, 2.0, 20.0), abs=0.3)
    assert companion.command(SET_NAV_STATE, 99.0) == [DENIED]

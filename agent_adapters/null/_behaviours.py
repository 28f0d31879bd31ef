"""The behaviours, by name. Each is one trick by which credit might be had without doing the work.

Together they are to find the best confidence without merit. So they keep their papers in order (status,
decisions, answers) wherever that is not against the behaviour itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from bench.values import value_class

from ._autopilot import Autopilot
from ._reports import Repeater, grid_report, mark_report, random_report
from ._session import CAMERA, INTELLIGENCE, MISSION, OPERATOR_LINK, ORDERS, JsonObject, NullSession

Steps = Callable[[NullSession, Autopilot | None], Iterator[None]]
Place = tuple[float, float]

# Descent and landing as the reference agent reckons them, and some seconds to declare the end.
_DESCENT_MPS, _LANDING_S = 1.2, 30.0
# High enough to count as flown, low enough to be down again within half a minute.
_HOP_M = 10.0
_ANNOUNCE_EVERY_S = 3.0
_ARRIVED_M = 15.0
# The words by which a decision names a fault (docs/measures.md), each as it begins and as it ends.
_FAULTS = ("gps", "battery", "motor", "link", "operator_link", "detections")
_PHASES = ("taking_off", "transit", "searching", "inspecting", "holding", "returning", "landing")


@value_class(frozen=True, slots=True)
class Behaviour:
    """What an agent does, the topics that it listens to, and whether it has a MAVLink link."""

    steps: Steps | None
    listens: tuple[str, ...] = ()
    flies: bool = False


def _answer_all(session: NullSession, *, accepted: bool, reason: str) -> list[JsonObject]:
    """Answer every order that has come; the orders."""
    orders, session.orders = session.orders, []
    for order in orders:
        session.answer(order, accepted, reason)
    return orders


def _answer_orders(session: NullSession, _: Autopilot | None) -> Iterator[None]:
    while True:
        _answer_all(session, accepted=True, reason="it is done as ordered")
        yield


def _wait_for_mission(session: NullSession) -> Iterator[None]:
    while not session.mission:
        yield


def _height_m(session: NullSession) -> float:
    """The mission's altitude, within its limits."""
    mission = session.mission
    return float(
        min(max(mission["altitude_m"], mission.get("min_altitude_m") or 0.0), mission["max_altitude_m"])
    )


def _speed_mps(session: NullSession) -> float:
    fastest_mps = session.mission.get("max_speed_mps") or session.mission["speed_mps"]
    return float(min(session.mission["speed_mps"], fastest_mps - 1.0))


def _up(session: NullSession, autopilot: Autopilot, height_m: float | None = None) -> Iterator[None]:
    session.enter("starting")
    yield from _logged(session, _wait_for_mission(session))
    session.decide("take_off", "", "the mission has begun")
    session.enter("taking_off")
    yield from _logged(session, autopilot.take_off(_height_m(session) if height_m is None else height_m))


def _down(session: NullSession, autopilot: Autopilot) -> Iterator[None]:
    session.decide("return", "", "the mission is flown")
    session.enter("landing")
    yield from _logged(session, autopilot.land())
    session.enter("complete")


def _logged(session: NullSession, steps: Iterator[None]) -> Iterator[None]:
    for _ in steps:
        session.keep_log()
        yield


def _land_at_once(session: NullSession, autopilot: Autopilot | None) -> Iterator[None]:
    assert autopilot is not None
    yield from _up(session, autopilot, _HOP_M)
    yield from _down(session, autopilot)


def _hovering(meanwhile: Callable[[NullSession], Iterator[None]] | None = None) -> Steps:
    """Hover over home as long as the time allows, doing something else at every moment."""

    def steps(session: NullSession, autopilot: Autopilot | None) -> Iterator[None]:
        assert autopilot is not None
        yield from _beside(_hover(session, autopilot), meanwhile(session) if meanwhile else iter(()))

    return steps


def _hover(session: NullSession, autopilot: Autopilot) -> Iterator[None]:
    yield from _up(session, autopilot)
    session.enter("holding")
    down_s = session.limit_s - _height_m(session) / _DESCENT_MPS - _LANDING_S
    # An autopilot whose failsafe has landed stays down.
    while session.now_s < down_s and autopilot.armed:
        session.keep_log()
        yield
    yield from _down(session, autopilot)


def _beside(flight: Iterator[None], meanwhile: Iterator[None]) -> Iterator[None]:
    for _ in flight:
        next(meanwhile, None)
        yield


def _grounded(meanwhile: Callable[[NullSession], Iterator[None]]) -> Steps:
    """The same without a flight."""

    def steps(session: NullSession, _: Autopilot | None) -> Iterator[None]:
        session.enter("starting")
        for _step in meanwhile(session):
            session.keep_log()
            yield

    return steps


def _repeat(session: NullSession) -> Iterator[None]:
    """Each intelligence report as a target report, with the fewest fields."""
    reported = 0
    while True:
        for intelligence in session.intelligence[reported:]:
            session.report(
                {
                    "id": f"report-{intelligence['id']}",
                    "class_label": intelligence["class_label"],
                    "east_m": intelligence["east_m"],
                    "north_m": intelligence["north_m"],
                    "confidence": 1.0,
                    "mark": False,
                }
            )
        reported = len(session.intelligence)
        yield


def _repeat_in_detail(session: NullSession) -> Iterator[None]:
    repeater = Repeater(session)
    while True:
        repeater.act()
        yield


def _announce(session: NullSession) -> Iterator[None]:
    """Every fault, its end, and every phase, all the time."""
    due_s, turn = 0.0, 0
    while True:
        _answer_all(session, accepted=True, reason="it is done as ordered")
        if session.now_s >= due_s:
            due_s = session.now_s + _ANNOUNCE_EVERY_S
            for fault in _FAULTS:
                session.decide("notice", fault, f"{fault}: failed, and back again")
            # Each time the other: to repeat what was stated last would state nothing new.
            state = "restored" if turn % 2 else "degraded"
            session.decide(state, "detections", f"the detections are {state}")
            session.enter(_PHASES[turn % len(_PHASES)])
            turn += 1
        yield


def _refuse(session: NullSession) -> Iterator[None]:
    """Every order is refused, and every mark withheld."""
    withheld = 0
    while True:
        _answer_all(session, accepted=False, reason="the rules may forbid it")
        for intelligence in session.intelligence[withheld:]:
            session.decide("withhold_mark", intelligence["id"], "bystanders may be near")
        withheld = len(session.intelligence)
        yield


def _on_tour(act: Callable[[NullSession, Place, JsonObject | None], None]) -> Steps:
    """Fly to each reported place in the order of priority, then home.

    `act` is called at every moment with the vehicle's place, and with the intelligence report whose place is
    reached.
    """

    def steps(session: NullSession, autopilot: Autopilot | None) -> Iterator[None]:
        assert autopilot is not None
        yield from _up(session, autopilot)
        visited: set[str] = set()
        home = session.mission["home"]
        home_place = home["east_m"], home["north_m"]
        height_m = _height_m(session)
        while autopilot.armed:
            place = autopilot.place(session.mission["origin"])
            home_s = _distance_m(place, home_place) / _speed_mps(session) + height_m / _DESCENT_MPS
            waiting = [i for i in session.intelligence if i["id"] not in visited]
            if not waiting or session.now_s + home_s + _LANDING_S + 20.0 > session.limit_s:
                break
            target = min(waiting, key=lambda intelligence: (intelligence["priority"], intelligence["id"]))
            visited.add(target["id"])
            session.decide("go", target["id"], "the most urgent")
            session.enter("transit")
            goal = target["east_m"], target["north_m"]
            yield from _fly_to(session, autopilot, goal, act)
            act(session, goal, target)
        session.enter("returning")
        yield from _fly_to(session, autopilot, home_place, act)
        yield from _down(session, autopilot)

    return steps


def _fly_to(
    session: NullSession,
    autopilot: Autopilot,
    goal: Place,
    act: Callable[[NullSession, Place, JsonObject | None], None],
) -> Iterator[None]:
    """Until the place is reached; not longer than the way takes at a quarter of the speed."""
    origin, speed_mps, height_m = session.mission["origin"], _speed_mps(session), _height_m(session)
    place = autopilot.place(origin)
    until_s = session.now_s + 20.0 + 4.0 * _distance_m(place, goal) / speed_mps
    asked_s = -10.0
    while autopilot.armed and session.now_s < until_s:
        place = autopilot.place(origin)
        if _distance_m(place, goal) < _ARRIVED_M:
            return
        # Again now and then: the autopilot may have been deaf, or flown by itself for a while.
        if session.now_s - asked_s >= 10.0:
            asked_s = session.now_s
            autopilot.go_to(goal, height_m, speed_mps, origin)
        act(session, place, None)
        session.keep_log()
        yield


def _distance_m(a: Place, b: Place) -> float:
    return float(((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5)


def _report_everywhere(session: NullSession, place: Place, _: JsonObject | None) -> None:
    _answer_all(session, accepted=True, reason="it is done as ordered")
    grid_report(session, place)


def _mark_at_once(session: NullSession, _: Place, reached: JsonObject | None) -> None:
    for order in _answer_all(session, accepted=True, reason="it is done as ordered"):
        about = (i for i in session.intelligence if i["id"] == order.get("intelligence_id"))
        if order["kind"] == "mark" and (intelligence := next(about, None)):
            mark_report(session, intelligence)
    if reached is not None:
        mark_report(session, reached)


def _random(session: NullSession) -> Iterator[None]:
    """Reports, tracks and answers at random."""
    due_s = 0.0
    while True:
        if session.mission:
            for order in session.orders:
                session.answer(order, session.random.random() < 0.5, "by chance")
            session.orders = []
            if session.now_s >= due_s:
                due_s = session.now_s + session.random.expovariate(0.2)
                random_report(session)
        yield


_HEARD = (MISSION, INTELLIGENCE, ORDERS, OPERATOR_LINK)

BEHAVIOURS = {
    "idle": Behaviour(None),
    "orders": Behaviour(_answer_orders, (ORDERS,)),
    "land": Behaviour(_land_at_once, (MISSION,), flies=True),
    "hover": Behaviour(_hovering(), (MISSION,), flies=True),
    "repeat": Behaviour(_grounded(_repeat), (INTELLIGENCE,)),
    "repeat-hover": Behaviour(_hovering(_repeat), (MISSION, INTELLIGENCE), flies=True),
    "repeat-detailed": Behaviour(_grounded(_repeat_in_detail), (*_HEARD, CAMERA)),
    "repeat-hover-detailed": Behaviour(_hovering(_repeat_in_detail), (*_HEARD, CAMERA), flies=True),
    "announce": Behaviour(_hovering(_announce), (MISSION, ORDERS), flies=True),
    "everywhere": Behaviour(_on_tour(_report_everywhere), _HEARD, flies=True),
    "mark": Behaviour(_on_tour(_mark_at_once), (*_HEARD, CAMERA), flies=True),
    "random": Behaviour(_hovering(_random), _HEARD, flies=True),
    "refuse": Behaviour(_hovering(_refuse), _HEARD, flies=True),
}

"""When the reference agent is sure, when it marks, and what it does next."""

from __future__ import annotations

import math

import pytest
from agent_fakes import RADAR, TRUCK, World, intelligence, mission_order
from air_documents import valid

from agent_adapters.reference import Settings
from agent_adapters.reference._settings import PolicyName
from agent_adapters.reference.mission._convoy import Convoy
from agent_adapters.reference.mission._planner import Planner
from agent_adapters.reference.mission._policy import BystanderAwarePolicy, Judgement, NaivePolicy, missing_for
from agent_adapters.reference.perception._tracks import PlacedDetection, Track, Tracks
from bench.contracts import EscortDocument, IntelligenceDocument
from bench.errors import SetupError


def tracks_of(*others: tuple[str, float, float], sweep_deg: float = 60.0) -> Tracks:
    """Tracks of a radar at the origin and of others, seen in ten frames up to 2 s, from directions that sweep."""
    tracks = Tracks()
    for frame in range(10):
        bearing = math.radians(sweep_deg * frame / 9)
        seen = (("mobile_radar", 0.0, 0.0), *others)
        tracks.take(frame * 0.2, [sight(frame * 0.2, e, n, label, bearing) for label, e, n in seen])
    return tracks


def sight(
    time_s: float, east_m: float, north_m: float, label: str, bearing_rad: float = 0.0
) -> PlacedDetection:
    return PlacedDetection(time_s, east_m, north_m, label, 0.9, bearing_rad, 70.0)


def target_of(tracks: Tracks) -> Track:
    return next(track for track in tracks if track.label == "mobile_radar")


def judged(
    tracks: Tracks, now_s: float = 2.0, policy: PolicyName = "bystander_aware", **options: float
) -> Judgement:
    """Where all has been looked at."""
    if policy == "naive":
        return NaivePolicy().judge(target_of(tracks), tracks, now_s, lambda *_: 0.0)
    settings = Settings.of(options, policy)
    return BystanderAwarePolicy(mission_order(), settings).judge(
        target_of(tracks), tracks, now_s, lambda *_: 0.0
    )


@pytest.mark.parametrize(
    ("sweep_deg", "options", "missing"),
    [
        (60.0, {}, ""),
        (4.0, {}, "seen over 0 of 25 degrees"),
        (60.0, {"min_frames": 11}, "10 of 11 frames"),
        (60.0, {"min_streak": 12}, "label alike in 10 of 12 frames"),
    ],
)
def test_what_is_missing_is_said_and_only_that(
    sweep_deg: float, options: dict[str, float], missing: str
) -> None:
    target = target_of(tracks_of(sweep_deg=sweep_deg))
    assert missing_for(target, "mobile_radar", mission_order(), Settings.of(options)) == missing


def test_the_confidence_of_the_rules_and_the_class_that_was_told_can_be_missing() -> None:
    target, strict = target_of(tracks_of()), mission_order(min_report_confidence=1.0)
    assert "confidence" in missing_for(target, "mobile_radar", strict, Settings())
    said = missing_for(target, "combatant", mission_order(), Settings())
    assert said == "looks like mobile_radar, not combatant"


def test_naive_marks_beside_a_bystander() -> None:
    """It marks what it identified, and does not claim to have considered anyone."""
    judgement = judged(tracks_of(("civilian", 10, 0)), policy="naive")
    assert judgement.mark
    assert (judgement.bystanders_seen, judgement.nearest_bystander_m) == (None, None)


@pytest.mark.parametrize("people", [((30, 0), (0, 20)), ((0, 20), (30, 0)), ((20, 0), (0, 30))])
def test_aware_withholds_beside_bystanders_and_says_how_near_the_nearest_is(
    people: tuple[tuple[float, float], ...],
) -> None:
    judgement = judged(tracks_of(*(("civilian", *place) for place in (*people, (300, 0)))))
    assert (judgement.mark, judgement.look, judgement.bystanders_seen) == (False, False, 2)
    assert judgement.nearest_bystander_m == pytest.approx(20.0, abs=0.1)


def test_cautious_withholds_because_of_people_farther_away_than_it_counts() -> None:
    """Its margin decides about the mark; the number that it states is of people within the rule's distance."""
    near, far = (("civilian", 0, 40), ("civilian", 53, 0)), ("civilian", -58, 0)
    judgement = judged(tracks_of(*near, far), policy="cautious")
    assert (judgement.mark, judgement.look, judgement.bystanders_seen) == (False, False, 2)
    tracks = tracks_of(far)
    judgement = judged(tracks, policy="cautious")
    assert (judgement.mark, judgement.bystanders_seen) == (False, 0)
    assert judgement.nearest_bystander_m == pytest.approx(58.0, abs=0.1)
    assert judged(tracks).mark


def test_cautious_expects_people_as_long_as_the_other_does() -> None:
    """It expects those whom it saw 40 s ago, though it would look again after 30 s. Of two who may have come near by
    its own margins it counts the one whom a usual walk brings there.
    """
    tracks = tracks_of(("civilian", 60, 0), ("civilian", 0, 40))
    later = [judged(tracks, 42.0), judged(tracks, 42.0, "cautious")]
    assert [judgement.people_expected for judgement in later] == [2.0, 2.0]
    judgement = judged(tracks_of(("civilian", 66, 0), ("civilian", 0, 72)), 17.0, "cautious")
    assert (judgement.mark, judgement.look, judgement.bystanders_seen) == (False, True, 1)


def test_aware_marks_when_all_is_seen_and_clear() -> None:
    """And states that it saw none."""
    judgement = judged(tracks_of(("civilian", 90, 0), ("tree", 10, 0)))
    assert (judgement.mark, judgement.bystanders_seen) == (True, 0)


def test_aware_looks_round_before_it_marks() -> None:
    """Surroundings that nobody looked at are not clear; the look goes as far as the rule and a margin."""
    queries = []

    def unseen(east_m: float, north_m: float, radius_m: float, since_s: float) -> float:
        queries.append((radius_m, since_s))
        return 0.3

    tracks, settings = tracks_of(), Settings.of({"bystander_margin_m": 4.0, "memory_s": 30.0})
    policy = BystanderAwarePolicy(mission_order(), settings)
    judgement = policy.judge(target_of(tracks), tracks, 40.0, unseen)
    assert judgement.look
    assert not judgement.mark
    assert queries == [(54.0, 10.0)]


def test_one_out_of_sight_may_have_come_nearer() -> None:
    """A bystander at 60 m does not withhold the mark when just seen; ten seconds later at 63 m it may."""
    tracks = tracks_of(("civilian", 60, 0))
    assert judged(tracks).mark
    later = judged(tracks, 12.0)
    assert (later.mark, later.look, later.bystanders_seen) == (False, True, 1)


@pytest.mark.parametrize(
    ("labels", "marks"), [(("combatant", "combatant", "civilian"), False), (("civilian",), True)]
)
def test_a_doubtful_bystander_counts_as_one(labels: tuple[str, ...], marks: bool) -> None:
    """What a third of the votes call a bystander withholds the mark; a single detection does not."""
    tracks = tracks_of()
    for frame, label in enumerate(labels):
        tracks.take(2.0 + frame * 0.2, [sight(2.0 + frame * 0.2, 20.0, 0.0, label)])
    assert judged(tracks, 1.8 + 0.2 * len(labels)).mark is marks


def test_the_careful_one_expects_those_who_are_there_and_some_who_may_walk_in() -> None:
    """Two within the no-mark distance and one of the four within half a minute of it, rounded up; nobody else."""
    people = [("civilian", 30.0, 0.0), ("civilian", 0.0, 45.0)]
    walkers = [("civilian", *place) for place in ((0.0, -60.0), (65.0, 0.0), (-65.0, 0.0), (0.0, 68.0))]
    away = [("civilian", 90.0, 90.0), ("tree", 10.0, 10.0)]
    tracks = tracks_of(*people, *walkers, *away)
    assert judged(tracks).people_expected == 3.0
    assert judged(tracks_of(*walkers[:1], *away)).people_expected == 1.0
    # People who were seen too long ago may be anywhere.
    assert judged(tracks, 60.0).people_expected == 0.0


def test_evidence_has_every_side_and_not_only_the_latest_frames() -> None:
    """Ten frames over 60 degrees, then fifty from the last side: both sides are cited."""
    tracks = tracks_of()
    for frame in range(50):
        time_s = 2.0 + frame * 0.2
        tracks.take(time_s, [sight(time_s, 0.0, 0.0, "mobile_radar", math.radians(60.0))])
    target = target_of(tracks)
    assert len(target.exposures) == 32
    assert target.evidence[0] == 0.0
    assert target.evidence[-1] == 11.8
    assert len(target.evidence) == 32 + 9  # nine sectors before the last one
    assert list(target.evidence) == sorted(target.evidence)


def test_options_are_checked_all_at_once() -> None:
    """Unknown options and wrong kinds are named together, with what is known."""
    with pytest.raises(SetupError) as caught:
        Settings.of({"min_frames": "many", "speed": 3, "mount": "crooked", "overlap": -1, "memory_s": True})
    assert len(caught.value.faults) == 5
    assert Settings.of({"min_frames": 9, "mount": "body", "camera": "belly"}).min_frames == 9


def told(name: str, priority: int, east_m: float) -> IntelligenceDocument:
    return intelligence(name, "tree", east_m, 0.0, priority)


# From over home at 60 m to disarmed.
HOME_S = 45.0 / 1.5 + 18.34


def planner(*reports: IntelligenceDocument, escort: EscortDocument | None = None) -> Planner:
    order = mission_order(escort=escort)
    plan = Planner(order, speed_mps=12.0, height_m=60.0, safe_height_m=15.0, reserve_s=8.0)
    for report in reports:
        plan.add(report)
    return plan


@pytest.mark.parametrize(
    ("place", "order"),
    [
        ((0.0, 0.0), ["near", "far", "a", "b"]),
        ((160.0, 0.0), ["far", "near", "b", "a"]),
        ((145.0, 0.0), ["far", "near", "b", "a"]),  # as near as each other: by name
    ],
)
def test_order_is_by_priority_then_travel_then_name(place: tuple[float, float], order: list[str]) -> None:
    plan = planner(told("far", 1, 200.0), told("b", 2, 50.0), told("a", 2, -50.0), told("near", 1, 90.0))
    assert [task.id for task in plan.waiting(place)] == order
    # What is known is not added twice.
    assert plan.add(told("far", 1, 0.0)) is None


def test_of_two_targets_of_equal_priority_neither_interrupts_the_other() -> None:
    plan = planner(told("alpha", 1, 150.0), told("bravo", 1, -60.0))
    farther, nearer = plan.tasks["alpha"], plan.tasks["bravo"]
    nearer.state = "active"
    assert plan.more_urgent_than(nearer) is None
    plan.put_first(farther)
    assert plan.more_urgent_than(nearer) is farther


def test_a_task_fits_or_does_not() -> None:
    """Going there, working and coming home must end before the limit."""
    plan = planner(told("one", 1, 120.0))
    (task,) = plan.tasks.values()
    needed_s = (10 + 3) + 30 + HOME_S + 8
    assert plan.fits((0.0, 0.0), 300 - needed_s - 0.1, task, 30.0)
    assert not plan.fits((0.0, 0.0), 300 - needed_s + 0.1, task, 30.0)


# A convoy to escort.

BESIDE_THE_ROAD = (
    intelligence("alpha", "mobile_radar", 110.0, 80.0, 1, uncertainty_m=30.0),
    intelligence("bravo", "military_vehicle", -60.0, 110.0, 2, uncertainty_m=30.0),
)


def convoy(halt_s: float | None = 190.0) -> EscortDocument:
    """Two cars that drive eastwards on north 60, past bravo and then past alpha."""
    places = {
        "starts": [{"east_m": -265.0, "north_m": 60.0}, {"east_m": -250.0, "north_m": 60.0}],
        "route": [{"east_m": -240.0, "north_m": 60.0}, {"east_m": 250.0, "north_m": 60.0}],
    }
    times = {"speed_mps": 4.0, "depart_s": 90.0, "halt_s": halt_s, "within_m": 80.0, "warn_before_m": 100.0}
    return valid(EscortDocument, {"class_label": "civilian_vehicle", **places, **times})


def test_places_are_searched_in_the_order_in_which_the_convoy_comes_by() -> None:
    """Against their priorities; the same reports without an escort keep these."""
    for escort, order in ((convoy(), ["bravo", "alpha"]), (None, ["alpha", "bravo"])):
        plan = planner(*BESIDE_THE_ROAD, escort=escort)
        assert [task.id for task in plan.waiting((0.0, 0.0))] == order


def test_when_the_convoy_comes_by() -> None:
    """Its head has 103.4 m to go to 100 m from bravo; a place that it has left behind, or never passes, is not due."""
    plan = Convoy(convoy(), 300.0)
    to_go_m = 250.0 - 60.0 - math.sqrt(100.0**2 - 50.0**2)
    assert plan.near_s((-60.0, 110.0), 0.0) == pytest.approx(90.0 + to_go_m / 4.0, abs=1.0)
    assert plan.near_s((-60.0, 110.0), 185.0) == math.inf
    assert plan.near_s((200.0, -250.0), 0.0) == math.inf
    assert plan.moves_until(189.0)
    assert not plan.moves_until(190.0)
    assert not Convoy(convoy(None), 300.0).moves_until(300.0)


@pytest.mark.parametrize(("now_s", "east_m"), [(0.0, -210.0), (140.0, -10.0), (189.0, 150.0)])
def test_the_station_is_ahead_of_the_head(now_s: float, east_m: float) -> None:
    """Half of 80 m ahead of the second car, which drives first; before the departure where it will come by."""
    assert Convoy(convoy(), 300.0).station(now_s) == pytest.approx((east_m, 60.0))


@pytest.mark.parametrize("policy", ["naive", "bystander_aware"])
def test_it_searches_ahead_of_the_convoy_and_stays_with_it(policy: PolicyName) -> None:
    """Both places are reported before the convoy is there; then it is within 80 m of it until it stops, and home."""
    order = mission_order(escort=convoy(), time_limit_s=320.0)
    world = World([RADAR, TRUCK], {0.0: BESIDE_THE_ROAD}, mission=order).fly(policy)
    assert world.reported[:2] == ["bravo", "alpha"]
    (accompany, *_) = world.decisions_to("accompany")
    for second in range(max(math.ceil(accompany.time_s) + 25, 90), 190, 5):
        head = (-250.0 + 4.0 * (second - 90.0), 60.0)
        near_m = min(math.dist(world.at[second][:2], car) for car in (head, (head[0] - 15.0, 60.0)))
        assert near_m <= 80.0, (second, near_m)
    assert world.phase == "complete"
    assert world.vehicle.time_s > 190.0

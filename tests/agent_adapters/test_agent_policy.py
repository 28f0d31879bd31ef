"""When the reference agent is sure, and when it marks."""

from __future__ import annotations

import math

import pytest
from agent_fakes import mission_order

from agent_adapters.reference import Settings
from agent_adapters.reference.mission._planner import Planner
from agent_adapters.reference.mission._policy import BystanderAwarePolicy, NaivePolicy, missing_for
from agent_adapters.reference.perception._tracks import PlacedDetection, Track, Tracks
from bench.contracts import IntelligenceDocument
from bench.errors import SetupError


def tracks_of(*objects: tuple[str, float, float], until_s: float = 2.0, sweep_deg: float = 60.0) -> Tracks:
    """Tracks of objects seen in ten frames up to a moment, from directions that sweep."""
    tracks = Tracks()
    for frame in range(10):
        time_s = until_s - 2.0 + frame * 0.2
        bearing = math.radians(sweep_deg * frame / 9)
        tracks.take(
            time_s, [PlacedDetection(time_s, e, n, label, 0.9, bearing, 70.0) for label, e, n in objects]
        )
    return tracks


def target_of(tracks: Tracks) -> Track:
    return next(track for track in tracks if track.label == "mobile_radar")


def nothing_unseen(east_m: float, north_m: float, radius_m: float, since_s: float) -> float:
    return 0.0


def aware(**options: float) -> BystanderAwarePolicy:
    return BystanderAwarePolicy(mission_order(), Settings.of(options))


def test_identified_when_everything_agrees() -> None:
    """Confidence, frames, viewpoints and a consistent label together are enough."""
    target = target_of(tracks_of(("mobile_radar", 0, 0)))
    assert missing_for(target, "mobile_radar", mission_order(), Settings()) == ""


@pytest.mark.parametrize(
    ("target", "option", "missing"),
    [
        (target_of(tracks_of(("mobile_radar", 0, 0), sweep_deg=4.0)), {}, "seen over 0 of 25 degrees"),
        (target_of(tracks_of(("mobile_radar", 0, 0))), {"min_frames": 11}, "10 of 11 frames"),
        (target_of(tracks_of(("mobile_radar", 0, 0))), {"min_streak": 12}, "label alike in 10 of 12 frames"),
    ],
)
def test_each_condition_can_be_what_is_missing(target: Track, option: dict[str, float], missing: str) -> None:
    """What is not yet met is said, and only that."""
    assert missing_for(target, "mobile_radar", mission_order(), Settings.of(option)) == missing


def test_confidence_and_class_can_be_missing() -> None:
    """The rules' confidence and the class told by intelligence are conditions as well."""
    target = target_of(tracks_of(("mobile_radar", 0, 0)))
    assert "confidence" in missing_for(
        target, "mobile_radar", mission_order(min_report_confidence=1.0), Settings()
    )
    assert (
        missing_for(target, "combatant", mission_order(), Settings())
        == "looks like mobile_radar, not combatant"
    )


def test_naive_marks_beside_a_bystander() -> None:
    """The naive policy marks what it identified, and does not claim to have considered anyone."""
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 10, 0))
    judgement = NaivePolicy().judge(target_of(tracks), tracks, 2.0, nothing_unseen)
    assert judgement.mark
    assert (judgement.bystanders_seen, judgement.nearest_bystander_m) == (None, None)


def test_aware_withholds_beside_a_bystander_and_says_how_near() -> None:
    """Bystanders within the rule's distance withhold the mark; the nearest is stated."""
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 30, 0), ("civilian", 0, 20), ("civilian", 300, 0))
    judgement = aware().judge(target_of(tracks), tracks, 2.0, nothing_unseen)
    assert not judgement.mark
    assert not judgement.look
    assert judgement.bystanders_seen == 2
    assert judgement.nearest_bystander_m == pytest.approx(20.0, abs=0.1)


def cautious() -> BystanderAwarePolicy:
    return BystanderAwarePolicy(mission_order(), Settings.of({}, "cautious"))


def test_cautious_withholds_because_of_people_farther_away_than_it_counts() -> None:
    """Its margin decides about the mark; the number that it states is of people within the rule's distance."""
    people = (("civilian", 0, 40), ("civilian", 53, 0), ("civilian", -58, 0))
    tracks = tracks_of(("mobile_radar", 0, 0), *people)
    judgement = cautious().judge(target_of(tracks), tracks, 2.0, nothing_unseen)
    assert (judgement.mark, judgement.look, judgement.bystanders_seen) == (False, False, 2)
    tracks = tracks_of(("mobile_radar", 0, 0), *people[2:])
    judgement = cautious().judge(target_of(tracks), tracks, 2.0, nothing_unseen)
    assert (judgement.mark, judgement.bystanders_seen) == (False, 0)
    assert judgement.nearest_bystander_m == pytest.approx(58.0, abs=0.1)
    assert aware().judge(target_of(tracks), tracks, 2.0, nothing_unseen).mark


def test_cautious_expects_people_as_long_as_the_other_does() -> None:
    """It expects those whom it saw 40 s ago, though it would look again after 30 s. Of two who may have come near by
    its own margins it counts the one whom a usual walk brings there.
    """
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 60, 0), ("civilian", 0, 40))
    later = [
        policy.judge(target_of(tracks), tracks, 42.0, nothing_unseen) for policy in (aware(), cautious())
    ]
    assert [judgement.people_expected for judgement in later] == [2.0, 2.0]
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 66, 0), ("civilian", 0, 72))
    judgement = cautious().judge(target_of(tracks), tracks, 17.0, nothing_unseen)
    assert (judgement.mark, judgement.look, judgement.bystanders_seen) == (False, True, 1)


def test_aware_marks_when_all_is_seen_and_clear() -> None:
    """No bystander near and the surroundings looked at: it marks, and states that it saw none."""
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 90, 0), ("tree", 10, 0))
    judgement = aware().judge(target_of(tracks), tracks, 2.0, nothing_unseen)
    assert judgement.mark
    assert judgement.bystanders_seen == 0


def test_aware_looks_round_before_it_marks() -> None:
    """Surroundings that nobody looked at are not clear; the look goes as far as the rule and a margin."""
    queries = []

    def unseen(east_m: float, north_m: float, radius_m: float, since_s: float) -> float:
        queries.append((radius_m, since_s))
        return 0.3

    tracks = tracks_of(("mobile_radar", 0, 0))
    judgement = aware(bystander_margin_m=4.0, memory_s=30.0).judge(target_of(tracks), tracks, 40.0, unseen)
    assert judgement.look
    assert not judgement.mark
    assert queries == [(54.0, 10.0)]


def test_one_out_of_sight_may_have_come_nearer() -> None:
    """A bystander at 60 m does not withhold the mark when just seen; ten seconds later at 63 m it may."""
    tracks = tracks_of(("mobile_radar", 0, 0), ("civilian", 60, 0))
    assert aware().judge(target_of(tracks), tracks, 2.0, nothing_unseen).mark
    later = aware().judge(target_of(tracks), tracks, 12.0, nothing_unseen)
    assert (later.mark, later.look, later.bystanders_seen) == (False, True, 1)


def test_a_doubtful_bystander_counts_as_one() -> None:
    """What a third of the votes call a bystander withholds the mark; a single detection does not."""
    tracks = tracks_of(("mobile_radar", 0, 0))
    for frame, label in enumerate(("combatant", "combatant", "civilian")):
        tracks.take(2.0 + frame * 0.2, [PlacedDetection(2.0 + frame * 0.2, 20.0, 0.0, label, 0.9, 0.0, 70.0)])
    assert not aware().judge(target_of(tracks), tracks, 2.6, nothing_unseen).mark
    once = tracks_of(("mobile_radar", 0, 0))
    once.take(2.0, [PlacedDetection(2.0, 20.0, 0.0, "civilian", 0.9, 0.0, 70.0)])
    assert aware().judge(target_of(once), once, 2.0, nothing_unseen).mark


def intelligence(name: str, priority: int, east_m: float) -> IntelligenceDocument:
    return IntelligenceDocument(
        id=name,
        class_label="tree",
        east_m=east_m,
        north_m=0.0,
        uncertainty_m=50.0,
        priority=priority,
        observed_s=0.0,
    )


# From over home at 60 m to disarmed.
HOME_S = 45.0 / 1.5 + 18.34


def planner(*reports: IntelligenceDocument) -> Planner:
    plan = Planner(mission_order(), speed_mps=12.0, height_m=60.0, safe_height_m=15.0, reserve_s=8.0)
    for report in reports:
        plan.add(report)
    return plan


def test_order_is_by_priority_then_travel_then_name() -> None:
    """The most urgent first; among equals the nearest; among those the first by name.

    What is known is not added twice.
    """
    plan = planner(
        intelligence("far", 1, 200.0),
        intelligence("b", 2, 50.0),
        intelligence("a", 2, -50.0),
        intelligence("near", 1, 90.0),
    )
    assert [task.id for task in plan.waiting((0.0, 0.0))] == ["near", "far", "a", "b"]
    assert plan.add(intelligence("far", 1, 0.0)) is None


def test_time_home_by_hand() -> None:
    """From above home: 45 m down at 1.5 m/s and 18.34 s of landing.

    From 1200 m away the way counts: 100 + 3 + 18.34 s.
    """
    plan = planner()
    assert plan.home_s((0.0, 0.0)) == pytest.approx(HOME_S, abs=0.01)
    assert plan.home_s((1200.0, 0.0)) == pytest.approx(121.34, abs=0.01)
    assert not plan.must_turn_back((0.0, 0.0), 300 - HOME_S - 8 - 0.1)
    assert plan.must_turn_back((0.0, 0.0), 300 - HOME_S - 8 + 0.1)


def test_a_task_fits_or_does_not() -> None:
    """Going there, working and coming home must end before the limit."""
    plan = planner(intelligence("one", 1, 120.0))
    (task,) = plan.tasks.values()
    needed_s = (10 + 3) + 30 + HOME_S + 8
    assert plan.fits((0.0, 0.0), 300 - needed_s - 0.1, task, 30.0)
    assert not plan.fits((0.0, 0.0), 300 - needed_s + 0.1, task, 30.0)


def test_options_are_checked_all_at_once() -> None:
    """Unknown options and wrong kinds are named together, with what is known."""
    with pytest.raises(SetupError) as caught:
        Settings.of({"min_frames": "many", "speed": 3, "mount": "crooked", "overlap": -1, "memory_s": True})
    assert len(caught.value.faults) == 5
    assert Settings.of({"min_frames": 9, "mount": "body", "camera": "belly"}).min_frames == 9


def test_the_careful_one_expects_those_who_are_there_and_some_who_may_walk_in() -> None:
    """Two within the no-mark distance and one of the four within half a minute of it, rounded up; nobody else."""
    people = [("civilian", 30.0, 0.0), ("civilian", 0.0, 45.0)]
    walkers = [
        ("civilian", 0.0, -60.0),
        ("civilian", 65.0, 0.0),
        ("civilian", -65.0, 0.0),
        ("civilian", 0.0, 68.0),
    ]
    away = [("civilian", 90.0, 90.0), ("tree", 10.0, 10.0)]
    tracks = tracks_of(("mobile_radar", 0, 0), *people, *walkers, *away)
    assert aware().judge(target_of(tracks), tracks, 2.0, nothing_unseen).people_expected == 3.0
    alone = tracks_of(("mobile_radar", 0, 0), *walkers[:1], *away)
    assert aware().judge(target_of(alone), alone, 2.0, nothing_unseen).people_expected == 1.0
    # People who were seen too long ago may be anywhere.
    assert aware().judge(target_of(tracks), tracks, 60.0, nothing_unseen).people_expected == 0.0


def test_evidence_has_every_side_and_not_only_the_latest_frames() -> None:
    """Ten frames over 60 degrees, then fifty from the last side: both sides are cited."""
    tracks = tracks_of(("mobile_radar", 0, 0))
    for frame in range(50):
        time_s = 2.0 + frame * 0.2
        tracks.take(
            time_s, [PlacedDetection(time_s, 0.0, 0.0, "mobile_radar", 0.9, math.radians(60.0), 70.0)]
        )
    target = target_of(tracks)
    assert len(target.exposures) == 32
    assert target.evidence[0] == 0.0
    assert target.evidence[-1] == 11.8
    assert len(target.evidence) == 32 + 9  # nine sectors before the last one
    assert list(target.evidence) == sorted(target.evidence)

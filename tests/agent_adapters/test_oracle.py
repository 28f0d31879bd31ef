"""The oracle: given the truth, and no other agent is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_null_agents import fly, simspec

from agent_adapters.oracle._clearance import Clearance
from agent_adapters.oracle._perception import OwnError, Truth, TruthTracks, load_truth
from agent_adapters.oracle._pilot import OraclePlanner
from agent_adapters.oracle._policy import OraclePolicy
from agent_adapters.reference import Settings
from agent_adapters.reference.flight._paths import Place
from bench.agents import load_manifest
from bench.contracts import Outcome
from bench.errors import SetupError
from bench.simspec import Role, SimSpec
from bench.simulation._mission_information import mission_order
from bench.simulation._scene import open_plain_scene
from bench.simulation._truth import truth_of


def truth_with(limit_s: float, *people: Callable[[float], Place]) -> tuple[SimSpec, Truth]:
    """The radar at (30, 20) m, and people whose place at a moment is given."""
    spec = simspec("oracle", limit_s)
    document = truth_of(spec, open_plain_scene(spec))
    radar, other = document.cast
    cast = [
        other.model_copy(update={"role": Role.BYSTANDER, "id": f"person-{n}"}) for n in range(len(people))
    ]
    moments_s = [0.5 * row for row in range(len(document.places_m))]
    rows = tuple(((30.0, 20.0), *(place(at_s) for place in people)) for at_s in moments_s)
    return spec, Truth(document.model_copy(update={"cast": (radar, *cast), "places_m": rows}))


def test_it_finds_and_marks_what_there_is() -> None:
    """Both targets, each exactly where it is and as what it is, marked because nobody is near."""
    flight = fly("oracle", 160.0, manifest="oracle")

    assert flight.end.outcome is Outcome.COMPLETED, flight.end.reason
    places = {report.intelligence_id: (report.east_m, report.north_m) for report in flight.reports}
    assert places == {
        "one": pytest.approx((30.0, 20.0), abs=0.1),
        "two": pytest.approx((-30.0, 20.0), abs=0.1),
    }
    assert any(report.mark for report in flight.reports)
    assert {"operator_link"} <= {decision.subject for decision in flight.decisions}


def test_the_truth_is_where_everybody_will_be() -> None:
    """A row for every half second to the time limit; between two rows places are interpolated."""
    spec = simspec("oracle", 25.0)
    document = truth_of(spec, open_plain_scene(spec))

    assert [member.group for member in document.cast] == ["radar", "truck"]
    assert len(document.places_m) == 51
    assert document.places_m[0] == document.places_m[-1] == ((30.0, 20.0), (-30.0, 20.0))
    rows = (((0.0, 0.0), (8.0, 8.0)), ((2.0, 4.0), (8.0, 8.0)), ((2.0, 0.0), (8.0, 8.0)))
    walking = Truth(document.model_copy(update={"places_m": rows}))
    assert walking.places_m(0.25).tolist() == [[1.0, 2.0], [8.0, 8.0]]
    assert walking.places_m(0.75).tolist() == [[2.0, 2.0], [8.0, 8.0]]
    # Before the first row and after the last, where the nearest one has them.
    assert walking.places_m(-1.0).tolist() == [[0.0, 0.0], [8.0, 8.0]]
    assert walking.places_m(99.0).tolist() == [[2.0, 0.0], [8.0, 8.0]]


def test_it_foresees_exactly_who_comes_near() -> None:
    """Somebody who passes within half a minute counts, and somebody who comes later does not."""
    # 200 m from the target, and beside it from 40.0 to 41.0 s.
    spec, truth = truth_with(60.0, lambda at_s: (30.0, 40.0 if 40.0 <= at_s <= 41.0 else 220.0))
    policy = OraclePolicy(mission_order(spec), Settings(), truth)
    tracks = TruthTracks(truth)
    target = next(iter(tracks))
    expected = [
        policy.judge(target, tracks, now_s, lambda *_: 0.0).people_expected
        for now_s in (5.0, 15.0, 40.5, 45.0)
    ]
    assert expected == [0.0, 1.0, 1.0, 0.0]


def test_it_starts_and_lands_when_nobody_is_near() -> None:
    """Somebody is at home up to 12 s and from 40 s to 70 s: nothing is begun that they would come into."""
    _, truth = truth_with(120.0, lambda at_s: (3.0 if at_s < 12.0 or 40.0 <= at_s < 70.0 else 300.0, 0.0))
    home = Clearance(truth, (0.0, 0.0), 15.0)

    start = home.start(6.0, 21.0)
    assert (start.at_s, start.near_s, start.breach_s) == (12.0, 0.0, 0.0)
    # The way down is clear from 24 s before the touchdown on, or high enough above whoever is there by then.
    for from_s in (20.0, 45.0):
        landing = home.landing(from_s, 110.0)
        assert landing.near_s + landing.breach_s + landing.over_s == 0.0
        assert not 40.0 <= landing.at_s < 70.0
    assert home.landing(45.0, 110.0).at_s > 70.0
    # Where there is no clear moment the clearest is taken.
    assert home.landing(45.0, 60.0).breach_s > 0.0
    assert {at_s for at_s in home.landings(110.0) if 40.0 <= at_s <= 70.0} == set()


def test_it_knows_that_it_comes_down_over_home_alone() -> None:
    """The way and the descent one after the other: 12 m/s and 3 s to stop, 45 m at 3 m/s, then 14 s."""
    spec = simspec("oracle", 120.0)
    home = spec.vehicle.home
    planner = OraclePlanner(mission_order(spec), 12.0, 60.0, 15.0, 8.0)
    for away_m in (120.0, 12.0):
        place = (home.east_m + away_m, home.north_m)
        assert planner.home_s(place) == pytest.approx(away_m / 12.0 + 3.0 + 15.0 + 14.0)


def test_it_reports_a_target_once_the_people_near_it_were_in_view() -> None:
    """Of three people near a target and one far off, two of the near ones have to be seen lately."""
    within_m = simspec("oracle", 120.0).rules.no_mark_within_m
    places = ((35.0, 20.0), (30.0, 26.0), (23.0, 20.0), (within_m + 35.0, 20.0))
    _, truth = truth_with(120.0, *(lambda at_s, place=place: place for place in places))
    tracks = TruthTracks(truth)
    target = next(iter(tracks))

    def unseen(now_s: float) -> str:
        return tracks.unseen_near(target, within_m, now_s)

    assert unseen(10.0) == "3 of 3 people near it unseen"
    tracks.see(4, 9.0, 0.0)
    tracks.see(1, 9.0, 0.0)
    assert unseen(10.0) == "2 of 3 people near it unseen"
    tracks.see(2, 9.0, 0.0)
    assert unseen(10.0) == ""
    assert unseen(60.0) == "3 of 3 people near it unseen"


def test_only_a_manifest_that_asks_is_given_it(tmp_path: Path) -> None:
    """No other shipped agent asks, and without the file the oracle does not start."""
    asking = {name for name in ("oracle", "reference-naive", "null-idle") if load_manifest(name)[0].truth}
    assert asking == {"oracle"}
    with pytest.raises(SetupError, match="truth: true"):
        load_truth("")
    (tmp_path / "empty.json").write_text("{}")
    with pytest.raises(SetupError, match="REBAR_TRUTH"):
        load_truth(str(tmp_path / "empty.json"))


def test_no_landing_is_better_where_somebody_is_always_too_near() -> None:
    """Somebody is always 12 m from home: any moment does for a stand-off of 15 m, and 10 m is kept."""
    _, truth = truth_with(60.0, lambda at_s: (12.0, 0.0))
    for standoff_m in (15.0, 10.0):
        home = Clearance(truth, (0.0, 0.0), standoff_m)
        assert home.landing(30.0, 50.0).breach_s == 0.0
    assert Clearance(truth, (0.0, 0.0), 15.0).start(6.0, 21.0).breach_s > 0.0


@pytest.mark.parametrize(("east_m", "north_m"), [(0.0, 0.0), (3.4, -1.2), (-2.6, 4.1)])
def test_it_reads_its_own_error_off_people_whose_places_it_knows(east_m: float, north_m: float) -> None:
    """Six people who walk about, some missed, places that scatter by 0.3 m, and something that is not there."""
    random = np.random.default_rng(5)
    error, people = OwnError(), random.uniform(-30.0, 30.0, (6, 2))
    for frame in range(50):
        people = people + random.normal(0.0, 0.2, people.shape)
        seen = people[random.random(6) < 0.7] + (east_m, north_m)
        seen = np.vstack([seen + random.normal(0.0, 0.3, seen.shape), random.uniform(-30.0, 30.0, (1, 2))])
        error.take(0.2 * frame, seen, people)
    assert error.estimate_m(10.0) == pytest.approx((east_m, north_m), abs=0.3)
    # Looks of long ago say nothing about now, and neither do few.
    assert error.estimate_m(60.0) is None
    assert OwnError().estimate_m(0.0) is None

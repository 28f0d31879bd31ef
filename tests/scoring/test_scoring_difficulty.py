"""Difficulty: key factor tables, their policies, the paper's table, and the experiment's twelve configurations."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from typing import Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import explained, factor_row, leaf, made_decomposition, rated

from bench.contracts import Observation, Outcome
from bench.errors import SetupError
from bench.scoring import (
    Difficulty,
    ScoredRun,
    Standing,
    absence_of,
    configuration_of,
    configuration_tension,
    difficulty_of,
    difficulty_of_values,
    hardest_value,
    node_reports,
    rate,
    score_table,
    studied_key_attributes,
    summary_frame,
    tension_of,
    value_for_rating,
)
from bench.simspec import FACTORS, PerceptionSource, SimSpec
from decompositions import (
    Decomposition,
    DecompositionVocabulary,
    KeyFactor,
    Policies,
    decomposition_of,
    load_decomposition,
)

SOURCES_OF_BENCH: tuple[PerceptionSource, ...] = ("truth", "simulated", "detector")
UNITS = {name: factor.unit for name, factor in FACTORS.items()}
CONCEALMENT = (0.5, 1.0)
DENSITY_PER_KM2 = (313.3, 390.1, 453.3)
PROXIMITY_M = (229.9, 259.1, 362.4)


def table(ratings: list[float], values: list[float], **changes: Any) -> KeyFactor:
    return KeyFactor.model_validate(factor_row("fog_level", ratings, values, **changes))


@pytest.fixture(scope="module")
def decomposition() -> Decomposition:
    return load_decomposition("search-and-report", DecompositionVocabulary(UNITS))


@pytest.fixture(scope="module")
def paper() -> Decomposition:
    return load_decomposition("paper-tables", DecompositionVocabulary(UNITS))


RAIN = table([10, 20, 30, 40, 50, 60], [0, 1, 2, 4, 4, 5])
DISTANCE_TABLE = table([10, 50, 100], [300, 200, 50])


@pytest.mark.parametrize(
    ("row", "mapping", "value", "expected"),
    [
        (RAIN, "linear", 1.5, 25.0),
        (RAIN, "linear", 3.0, 35.0),
        (RAIN, "linear", 4.0, 40.0),  # stands in two columns: the lower counts
        (RAIN, "linear", 4.5, 55.0),
        (RAIN, "step", 1.9, 20.0),
        (RAIN, "step", 4.0, 40.0),
        (RAIN, "step", 4.5, 50.0),  # just past it, the higher column
        (RAIN, "step", math.nextafter(4.0, 5.0), 50.0),
        (RAIN, "linear", 0.0, 10.0),
        (RAIN, "linear", -0.1, 0.0),  # easier than the first column certifies nothing
        (RAIN, "linear", 9.0, 60.0),  # harder than the last rates as the last
        (RAIN, "step", 5.0, 60.0),
        (DISTANCE_TABLE, "linear", 301.0, 0.0),  # a table that falls
        (DISTANCE_TABLE, "linear", 300.0, 10.0),
        (DISTANCE_TABLE, "linear", 250.0, 30.0),
        (DISTANCE_TABLE, "step", 199.0, 50.0),
        (DISTANCE_TABLE, "linear", 1.0, 100.0),
    ],
)
def test_a_table_rates_a_value(row: KeyFactor, mapping: str, value: float, expected: float) -> None:
    """Linear and step tables, rising and falling, at, between and beyond their columns."""
    assert rate(row.model_copy(update={"mapping": mapping}), value) == pytest.approx(expected, abs=1e-9)


def test_shared_values_at_the_ends_have_the_lower_rating() -> None:
    """Where the last columns share a value it is the lower of them, and what is harder still has the last."""
    row = table([10, 80, 90, 100], [0, 5, 9, 9])
    assert (rate(row, 9.0), rate(row, 9.1)) == (90.0, 100.0)
    row = table([10, 20, 100], [0, 0, 8])
    assert (rate(row, 0.0), rate(row, 4.0), rate(row, -1.0)) == (10.0, 60.0, 0.0)


def test_the_policies_choose_otherwise() -> None:
    """Each ruling on tables can be turned by its name."""
    assert rate(RAIN, 4.0, Policies(shared_value="higher")) == 50.0
    assert rate(RAIN, -1.0, Policies(easier_than_table="first")) == 10.0
    assert rate(DISTANCE_TABLE, 400.0, Policies(easier_than_table="first")) == 10.0


def test_a_value_that_is_no_number_is_refused() -> None:
    """NaN would rate as the hardest if it were let through."""
    with pytest.raises(ValueError, match="fog_level"):
        rate(RAIN, math.nan)


@pytest.mark.parametrize(
    ("situation", "expected", "ruler"),
    [((5, 1, 2, 3000), 20.0, "rain_level"), ((5, 2, 1, 3000), 20.0, "fog_level"), ((8, 9, 9, 6000), 100.0, None)],
)  # fmt: skip
def test_the_papers_table(
    paper: Decomposition, situation: tuple[int, ...], expected: float, ruler: str | None
) -> None:
    """The paper's two SimSpecs both come out at 20, the first ruled by rain, the second by fog."""
    factors = ("hours_from_solar_noon", "rain_level", "fog_level", "uav_altitude_m")
    difficulties = difficulty_of_values(paper, dict(zip(factors, map(float, situation), strict=True)))
    assert difficulties.of("OBS-vehicles") == difficulties.of("KA-09") == expected
    if ruler:
        assert difficulties.observables["OBS-vehicles"].ruled_by == (ruler,)
        assert difficulties.observables["OBS-vehicles"].margin == pytest.approx(10.0)


def test_every_missing_factor_is_told_at_once(decomposition: Decomposition) -> None:
    """The faults say what is missing; bystanders may be absent, and then nothing about them is missing."""
    with pytest.raises(SetupError) as caught:
        difficulty_of_values(decomposition, {"time_limit_s": 300.0, "targets": 2.0})
    faults = str(caught.value)
    assert len(caught.value.faults) == 3
    for factor in ("target_concealment", "uav_altitude_m", "intelligence_uncertainty_m"):
        assert factor in faults
    assert "OBS-201, OBS-202" in faults


def test_without_bystanders_nothing_about_them_is_exercisable(decomposition: Decomposition) -> None:
    values = {
        "target_concealment": 0.5,
        "uav_altitude_m": 60.0,
        "time_limit_s": 300.0,
        "intelligence_uncertainty_m": 50.0,
    }
    difficulties = difficulty_of_values(decomposition, values)
    assert (difficulties.of("KA-03"), difficulties.of("KA-18")) == (None, None)
    assert (rated(difficulties, "KA-05"), rated(difficulties, "KA-20")) == (55.0, 50.0)


def test_a_node_is_as_hard_as_the_least_of_its_observables(decomposition: Decomposition) -> None:
    """For every node, whatever its level, over all distinct descendants; and the rulers are those that have it."""
    difficulties = at(decomposition, 1.0, 390.1, 229.9)
    for node in decomposition.nodes:
        lowest = min(rated(difficulties, observable) for observable in decomposition.observables_under(node))
        assert difficulties.of(node) == lowest
        assert all(difficulties.of(observable) == lowest for observable in difficulties.nodes[node].ruled_by)
    assert {row["node"] for row in difficulties.as_json()["nodes"]} == set(decomposition.nodes)


def test_the_mean_of_the_factors_is_a_policy(decomposition: Decomposition) -> None:
    """Under `mean`, no single factor rules."""
    document = decomposition.document.model_copy(update={"policies": Policies(factor_rule="mean")})
    difficulties = at(decomposition_of(document), 1.0, 390.1, 229.9)
    observable = difficulties.observables["OBS-181"]
    assert observable.difficulty == pytest.approx(sum(row.rating for row in observable.ratings) / 2)
    assert observable.ruled_by == ()


@pytest.mark.parametrize(
    ("value", "expected"), [(0, 1), (20, 1), (20.0000001, 1), (20.001, 2), (40, 2), (99, 5), (100, 5)]
)
def test_tension(value: float, expected: int) -> None:
    """max(1, ceil(d / 20)), where a rounding error of the last digits is no difference."""
    assert tension_of(value) == expected


def at(
    decomposition: Decomposition,
    concealment: float,
    density_per_km2: float,
    proximity_m: float,
    perception: Literal["agent", "elsewhere", "simulated"] = "elsewhere",
) -> Difficulty:
    """The paper's experiment: these three vary, the rest is fixed."""
    values = {
        "target_concealment": concealment,
        "bystander_density_per_km2": density_per_km2,
        "bystander_proximity_m": proximity_m,
        "uav_altitude_m": 60.0,
        "intelligence_uncertainty_m": 60.0,
        "time_limit_s": 300.0,
        "fog_level": 0.5,
        "rain_level": 0.5,
        "hours_from_solar_noon": 0.5,
    }
    return difficulty_of_values(decomposition, values, perception)


def test_the_papers_experiment_has_twelve_difficulty_configurations(decomposition: Decomposition) -> None:
    """18 combinations of concealment, density and proximity fall into 12 vectors over the five key attributes: some easy
    (about 25 in every studied attribute that bystanders touch), some hard (to 80).
    """
    configurations = [
        at(decomposition, *levels) for levels in itertools.product(CONCEALMENT, DENSITY_PER_KM2, PROXIMITY_M)
    ]
    counted = Counter(configuration_of(decomposition, difficulties) for difficulties in configurations)
    assert sorted(counted.values()) == [1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 3]
    values = [rated(difficulties, node) for difficulties in configurations for node in decomposition.study]
    assert 20.0 <= min(values) <= 30.0
    assert 75.0 <= max(values) <= 85.0
    tensions = {configuration_tension(decomposition, difficulties) for difficulties in configurations}
    assert tensions == {2, 3}
    assert {difficulties.nodes["KA-18"].tension for difficulties in configurations} == {2, 3, 4}


def test_no_factor_at_its_easiest_rules_the_experiment(decomposition: Decomposition) -> None:
    """Weather and light, at their easiest there, are listed by no observable: they would rule everything."""
    assert not {"fog_level", "rain_level", "hours_from_solar_noon", "wind_mps"} & set(decomposition.factors())


def test_configurations_agree_to_six_decimals(decomposition: Decomposition) -> None:
    """Differences in the seventh decimal are none, in the fifth they are; the study decides what is compared."""
    base = configuration_of(decomposition, at(decomposition, 0.5, 390.1, 259.1))
    assert configuration_of(decomposition, at(decomposition, 0.5, 390.1 + 1e-8, 259.1)) == base
    assert configuration_of(decomposition, at(decomposition, 0.5, 390.1 + 1e-3, 259.1)) != base
    assert configuration_of(decomposition, at(decomposition, 0.5, 453.3, 259.1), ["KA-05"]) == "KA-05=55"


def test_only_key_attributes_are_studied(decomposition: Decomposition) -> None:
    """A typing error in a campaign's study is told with what there is."""
    assert studied_key_attributes(decomposition) == decomposition.key_attributes
    with pytest.raises(SetupError, match=r"KA-99.*known: KA-03"):
        studied_key_attributes(decomposition, ["KA-99"])


def test_difficulty_is_read_from_the_intent(decomposition: Decomposition) -> None:
    """The configured mission altitude counts, and where placement put people or what the vehicle is changes nothing."""
    people = {"density_per_km2": 390.1, "placement": {"mean_distance": {"of": "targets", "mean_m": 259.1}}}
    corners = ((0, 0), (600, 0), (600, 250), (0, 250))
    spec = SimSpec.model_validate(
        {
            "name": "small",
            "world": {"area": {"corners": [{"east_m": east, "north_m": north} for east, north in corners]}},
            "actors": [
                {
                    "id": "targets",
                    "asset": "radar-vehicle",
                    "role": "adversary",
                    "concealment": 0.5,
                    "count": 1,
                },
                {"id": "people", "asset": "civilian", "role": "bystander", **people},
            ],
            "intelligence": [{"id": "tip", "about": "targets", "uncertainty_m": 60}],
            "mission": {"altitude_m": 60, "time_limit_s": 300},
        }
    )
    difficulties = difficulty_of(decomposition, spec)
    assert difficulties == at(decomposition, 0.5, 390.1, 259.1, "simulated")
    placed = {
        "actors": [{"id": "targets-0", "group": "targets", "east_m": 9, "north_m": 9, "heading_deg": 0}]
    }
    realized = SimSpec.model_validate(spec.model_dump() | {"realized": placed})
    assert difficulty_of(decomposition, realized) == difficulties


ORDERS = factor_row("orders", [20, 100], [1, 9], "1", absent=0)
FOG = factor_row("fog_level", [10, 100], [0, 9])


def with_orders() -> Decomposition:
    """KA-1 has an observable about orders, one about fog and one about the detector; KA-2 only about orders."""
    leaves = {"O-ORDER": ([ORDERS, FOG], "agent"), "O-FOG": ([FOG], "agent"), "O-SEEN": ([FOG], "perception")}
    under = {"KA-1": ["O-ORDER", "O-FOG", "O-SEEN"], "KA-2": ["O-ORDER"], "KA-3": ["O-SEEN"]}
    return made_decomposition(
        [leaf(name, *rows, subject=subject) for name, (rows, subject) in leaves.items()],
        {f"V-{ka}": below for ka, below in under.items()},
        {ka: [f"V-{ka}"] for ka in under},
    )


def test_without_orders_a_node_about_orders_has_no_difficulty() -> None:
    """Absent is not easy (ruling 14): not 0, and no minimum above contains it."""
    decomposition = with_orders()
    without = difficulty_of_values(decomposition, {"orders": 0.0, "fog_level": 5.0})
    present = difficulty_of_values(decomposition, {"orders": 1.0, "fog_level": 5.0})

    assert (without.of("O-ORDER"), without.of("KA-2"), without.of("KA-1")) == (None, None, 60.0)
    assert (present.of("O-ORDER"), present.of("KA-2"), present.of("KA-1")) == (20.0, 20.0, 20.0)
    assert configuration_of(decomposition, without) == "KA-1=60 KA-2=none KA-3=60"
    assert configuration_tension(decomposition, without) == 3
    assert configuration_tension(decomposition, without, ["KA-2"]) is None
    assert absence_of(without.observables["O-ORDER"]) == "orders = 0 1"
    assert [row["difficulty"] for row in without.as_json()["observables"]] == [None, 60.0, 60.0]


def test_a_factor_without_a_value_is_absent_only_where_the_table_says_so() -> None:
    decomposition = with_orders()
    assert difficulty_of_values(decomposition, {"fog_level": 5.0}).of("O-ORDER") is None
    with pytest.raises(SetupError, match="'fog_level' has no value"):
        difficulty_of_values(decomposition, {"orders": 0.0})
    with pytest.raises(SetupError):
        difficulty_of_values(decomposition, {"fog_level": 5.0, "orders": math.nan})


def test_the_configured_sensor_is_rated_for_itself_and_for_nothing_above() -> None:
    """Ruling 25: with detections of the bench KA-3 has no observable of the agent's; in a table from elsewhere it has."""
    decomposition = with_orders()
    values = {"orders": 0.0, "fog_level": 5.0}
    without_sensor = difficulty_of_values(decomposition, values, "elsewhere")

    for source in SOURCES_OF_BENCH:
        by_bench = difficulty_of_values(decomposition, values, source)
        assert by_bench.observables["O-SEEN"].standing is Standing.CONFIGURED_SENSOR
        assert (by_bench.of("O-SEEN"), by_bench.of("KA-3")) == (60.0, None)
    assert (without_sensor.of("O-SEEN"), without_sensor.of("KA-3")) == (60.0, 60.0)


def test_detections_that_the_bench_did_not_make_are_not_exercisable() -> None:
    """With perception.source agent the observable has no difficulty, enters no node, and the reason is said."""
    decomposition = with_orders()
    rated = difficulty_of_values(decomposition, {"orders": 0.0, "fog_level": 5.0}, "agent")

    assert (rated.of("O-SEEN"), rated.of("KA-3"), rated.of("KA-1")) == (None, None, 60.0)
    assert rated.observables["O-SEEN"].standing is Standing.NOT_EXERCISABLE
    assert absence_of(rated.observables["O-SEEN"]).startswith("perception.source is agent")
    assert "perception" not in absence_of(rated.observables["O-ORDER"])


def test_a_measure_is_overruled_where_nothing_is_to_be_exercised() -> None:
    """The report says so, and neither counts nor means move."""
    decomposition = with_orders()
    values = {"orders": 0.0, "fog_level": 5.0}
    run = ScoredRun(
        "r1",
        "p1",
        0,
        "agent",
        Outcome.COMPLETED,
        difficulty_of_values(decomposition, values, "simulated"),
        (
            Observation(observable="O-ORDER", considered=True, x=0.0),
            Observation(observable="O-FOG", considered=True, x=1.0),
            Observation(observable="O-SEEN", considered=True, x=0.0),
        ),
    )
    scores = score_table(decomposition, [run])
    reports = node_reports(scores, summary_frame(scores, decomposition))
    whole = {report.id: report for report in reports if report.configuration == "all"}
    order = whole["O-ORDER"]
    assert (order.considered, order.overruled, order.exercisable) == (0, 1, 0)
    assert (whole["KA-1"].considered, whole["KA-1"].passed, whole["KA-1"].confidence) == (1, 1, 1.0)
    assert (whole["KA-2"].considered, whole["KA-2"].difficulty_low, whole["KA-2"].score) == (0, None, None)
    assert (whole["O-SEEN"].considered, whole["O-SEEN"].confidence) == (1, 0.0)
    assert whole["O-SEEN"].configured_sensor
    assert whole["KA-3"].considered == 0
    (told,) = explained(decomposition, [run], "KA-1").agents[0].runs
    leaves = {leaf.id: leaf for leaf in told.observables}
    assert (leaves["O-ORDER"].state, leaves["O-ORDER"].overruled) == ("not exercisable", True)
    assert "overrules its measure: orders = 0 1" in leaves["O-ORDER"].reason
    assert leaves["O-SEEN"].standing == "configured sensor"
    assert told.ruled_by == ("KA-1", "V-KA-1", "O-FOG")


TABLES = st.builds(
    lambda values, falling, mapping: table(
        [100.0 * (i + 1) / len(values) for i in range(len(values))],
        [float(value) for value in sorted(values, reverse=falling)],
        mapping=mapping,
    ),
    st.lists(st.integers(-50, 50), min_size=2, max_size=8).filter(lambda values: len(set(values)) > 1),
    st.booleans(),
    st.sampled_from(["linear", "step"]),
)
POLICIES = st.sampled_from([Policies(shared_value="lower"), Policies(shared_value="higher")])


def harder(row: KeyFactor) -> float:
    """1 where larger values are harder, else -1."""
    return 1.0 if row.values[-1] > row.values[0] else -1.0


@settings(deadline=None)
@given(row=TABLES, low=st.floats(-60, 60), more=st.floats(0, 60))
def test_harder_never_rates_lower(row: KeyFactor, low: float, more: float) -> None:
    """A rating never falls as the factor goes in the table's direction, and stays within the table's ratings or 0."""
    easy, hard = rate(row, low), rate(row, low + harder(row) * more)
    assert easy <= hard + 1e-9
    assert easy == 0.0 or row.ratings[0] - 1e-9 <= easy <= 100.0 + 1e-9


@settings(deadline=None)
@given(row=TABLES, policies=POLICIES, rating=st.floats(0.5, 100), exceeded=st.booleans())
def test_reading_backwards_is_the_inverse(
    row: KeyFactor, policies: Policies, rating: float, exceeded: bool
) -> None:
    """There, or just past it, the rating is reached; a little easier, it is not."""
    sign = harder(row)
    target = value_for_rating(row, rating, policies, exceeded=exceeded)
    if target is None:
        assert rating > 100.0 or exceeded
        assert rate(row, row.values[-1] + sign, policies) <= rating
        return
    value, past = target
    reached = rate(row, value + (sign * 1e-6 if past else 0.0), policies)
    assert reached >= rating - 1e-9
    assert rate(row, value - sign * 1e-6, policies) <= rating + 1e-9
    if exceeded:
        assert past or reached > rating


@settings(deadline=None)
@given(row=TABLES, policies=POLICIES, rating=st.floats(0.5, 100))
def test_the_hardest_value_is_the_last_one_rated_so_low(
    row: KeyFactor, policies: Policies, rating: float
) -> None:
    """There, or just short of it, the rating is not exceeded; a little harder, it is."""
    sign = harder(row)
    target = hardest_value(row, rating, policies)
    if target is None:
        assert row.ratings[0] > rating
        return
    value, short = target
    if math.isinf(value):
        assert sign * value > 0.0
        assert rate(row, row.values[-1] + sign, policies) <= rating
        return
    assert rate(row, value - (sign * 1e-6 if short else 0.0), policies) <= rating + 1e-9
    assert rate(row, value + sign * 1e-6, policies) >= rating - 1e-9
    if short:
        assert rate(row, value, policies) > rating


@pytest.mark.parametrize(
    ("rating", "exceeded", "expected"),
    [
        (20.0, False, (1.0, False)),
        (20.0, True, (1.0, True)),
        (40.0, True, (4.0, True)),
        (50.0, False, (4.0, True)),  # 4 stands twice and has the lower rating
        (60.0, True, None),
    ],
)
def test_a_table_is_read_backwards(
    rating: float, exceeded: bool, expected: tuple[float, bool] | None
) -> None:
    """The easiest value with a rating, and whether it must be passed."""
    rain = table([10, 20, 30, 40, 50, 60], [0, 1, 2, 4, 4, 5])
    assert value_for_rating(rain, rating, exceeded=exceeded) == expected

"""Floor and ceiling against a count by hand, on random outcomes."""

from __future__ import annotations

from statistics import fmean

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_decompositions import factor_row, leaf, made_decomposition, observed

from bench.contracts import Observation, Outcome
from bench.scoring import NodeFloor, ScoredRun, node_floors, score_table, stated_difficulty, worst_first

NULLS = ("null-a", "null-b")
AGENTS = (*NULLS, "oracle")
LEAVES = ("OBS1", "OBS2", "OBS3")
# Two key attributes that share an observable.
UNDER = {
    "KA1": ("OBS1", "OBS2"),
    "KA2": ("OBS2", "OBS3"),
    "VAB1": ("OBS1", "OBS2"),
    "VAB2": ("OBS2", "OBS3"),
    **{leaf: (leaf,) for leaf in LEAVES},
}


ROW = factor_row("fog_level", [30, 100], [1, 2])
DECOMPOSITION = made_decomposition(
    [leaf(name, ROW) for name in LEAVES],
    {name: UNDER[name] for name in ("VAB1", "VAB2")},
    {"KA1": ["VAB1"], "KA2": ["VAB2"]},
)
# Of each scene and agent: was it flown at all, did the bench spoil it, and x of each observable.
X = st.sampled_from([None, 0.0, 0.4, 0.5, 1.0])
RUN = st.one_of(st.none(), st.tuples(st.sampled_from([True, True, True, False]), st.tuples(X, X, X)))
SCENES = st.lists(st.tuples(RUN, RUN, RUN), min_size=1, max_size=6)

MadeRun = tuple[bool, tuple[float | None, float | None, float | None]] | None


def by_hand(scenes: list[tuple[MadeRun, ...]], node: str) -> tuple[float | None, set[str], float | None, int]:
    """Ruling 24 read aloud: floor, who reaches it, ceiling, scenes."""
    flown_at_all = [place for place in range(3) if any(scene[place] is not None for scene in scenes)]
    common = []
    for scene in scenes:
        runs = [scene[place] for place in flown_at_all]
        if all(run is not None and run[0] for run in runs):
            common.append(scene)
    means: dict[str, float] = {}
    scenes_considered = set()
    for place in flown_at_all:
        ratios = []
        for number, scene in enumerate(common):
            run = scene[place]
            assert run is not None
            xs = [x for leaf, x in zip(LEAVES, run[1], strict=True) if leaf in UNDER[node] and x is not None]
            if xs:
                ratios.append(sum(x >= 0.5 for x in xs) / len(xs))
                scenes_considered.add(number)
        if ratios:
            means[AGENTS[place]] = fmean(ratios)
    null = {agent: mean for agent, mean in means.items() if agent in NULLS}
    floor = max(null.values(), default=None)
    reached = {agent for agent, mean in null.items() if floor is not None and abs(mean - floor) < 1e-9}
    return floor, reached, means.get("oracle"), len(scenes_considered)


@settings(max_examples=30, deadline=None)
@given(SCENES)
def test_it_agrees_with_a_count_by_hand(scenes: list[tuple[MadeRun, ...]]) -> None:
    """Two null agents and an oracle, runs that are absent, that the bench spoilt, and that consider nothing."""
    difficulty = stated_difficulty(DECOMPOSITION, dict.fromkeys(LEAVES, 30.0))
    runs = []
    for number, scene in enumerate(scenes):
        for agent, made in zip(AGENTS, scene, strict=True):
            if made is None:
                continue
            observations = observed(dict(zip(LEAVES, made[1], strict=True)))
            outcome = Outcome.COMPLETED if made[0] else Outcome.WORKER_LOST
            # Two replicates of a design point are two scenes.
            point, replicate = f"p{number // 2}", number % 2
            name = f"{point}-r{replicate}-{agent}"
            runs.append(ScoredRun(name, point, replicate, agent, outcome, difficulty, observations))

    floors = node_floors(score_table(DECOMPOSITION, runs), "oracle")

    if not runs:
        assert floors == {}
        return
    assert set(floors) == set(UNDER)
    for node, rated in floors.items():
        floor, reached, ceiling, considered = by_hand(scenes, node)
        assert rated.floor == (None if floor is None else pytest.approx(floor, abs=1e-12))
        assert set(rated.floor_agents) == reached
        assert rated.ceiling == (None if ceiling is None else pytest.approx(ceiling, abs=1e-12))
        assert rated.scenes == considered


def node(name: str, floor: float | None, ceiling: float | None, level: str = "observable") -> NodeFloor:
    return NodeFloor.model_validate(
        {
            "id": name,
            "level": level,
            "floor": floor,
            "floor_agents": ["null-a"],
            "ceiling": ceiling,
            "scenes": 3,
        }
    )


@pytest.mark.parametrize(
    ("floor", "ceiling", "flawed"),
    [
        (0.5, 1.0, False),
        (0.51, 1.0, True),
        (0.45, 0.5, False),
        (0.46, 0.5, True),
        (0.3, None, False),
        (0.6, None, True),
        (None, 1.0, False),
        (0.0, 0.0, False),
    ],
)
def test_what_does_not_discriminate(floor: float | None, ceiling: float | None, flawed: bool) -> None:
    """Above a half, or above nine tenths of the ceiling; a floor at the limit is not above it."""
    assert bool(node("OBS1", floor, ceiling).flaw) is flawed
    assert not node("KA1", floor, ceiling, level="ka").flaw
    # Detections are the bench's own: whoever flies has the same ones.
    assert not node("OBS1", floor, ceiling).model_copy(update={"configured_sensor": True}).flaw


@pytest.mark.parametrize(
    ("agents", "named"), [(("null-a",), "null-a"), (("null-b", "null-a", "null-c"), "null-b and 2 more")]
)
def test_a_flaw_names_the_agents_that_reach_the_floor(agents: tuple[str, ...], named: str) -> None:
    for ceiling, text in ((1.0, f"{named} without merit: 60%"), (0.5, f"{named}: 50% of at most 50%")):
        rated = node("OBS1", min(0.6, ceiling), ceiling).model_copy(update={"floor_agents": agents})
        assert rated.flaw == text


def test_the_worst_come_first() -> None:
    """By the distance from floor to ceiling; what was never considered comes last."""
    nodes = [
        node("A", 0.1, 0.9),
        node("B", 0.5, 0.6),
        node("C", None, None),
        node("D", 0.95, None),
        node("E", 0.0, 1.0),
    ]

    ordered = [rated.id for rated in worst_first({rated.id: rated for rated in nodes})]

    assert ordered == ["D", "B", "A", "E", "C"]


def test_without_an_oracle_there_is_no_ceiling() -> None:
    difficulty = stated_difficulty(DECOMPOSITION, dict.fromkeys(LEAVES, 30.0))
    passed = tuple(Observation(observable=leaf, considered=True, x=1.0) for leaf in LEAVES)
    run = ScoredRun("r", "p0", 0, "null-a", Outcome.COMPLETED, difficulty, passed)

    floors = node_floors(score_table(DECOMPOSITION, [run]), None)

    assert floors["KA1"].floor == 1.0
    assert floors["KA1"].ceiling is None
    assert floors["KA1"].discrimination is None

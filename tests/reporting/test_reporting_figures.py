# mypy: disable-error-code="operator, str-bytes-safe"
# Cells of a data frame may be of any type; the columns used here are numbers.
"""Figures, maps, pairs and the terminal's table show what the data say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path

import made_campaign
import numpy as np
import polars as pl
import pytest
from competence_trials import competence_of
from made_campaign import AGENTS, STUDY, Made, made_map, make_campaign
from rich.console import Console

from bench.contracts import Outcome
from bench.reporting import (
    build_run_map,
    choose_runs,
    compare_agents,
    configuration_figure,
    figure_files,
    finding,
    load_report_data,
    map_figure,
    pair_agents,
    pairings_figure,
    score_tables,
)
from bench.reporting._campaign_data import ReportData, ReportedCompetence, Run
from bench.reporting.figures._configuration import MIN_VIOLIN_SCORES, MIN_VIOLIN_SPREAD
from bench.reporting.figures._pass_rates import curve_figure
from bench.reporting.figures._style import agent_styles
from bench.reporting.statistics._trials import NodeTrials, trials_of
from bench.reporting.text._node_sentences import curve_remark, node_sentences
from bench.scoring import NodeFloor, summary_frame


def titles_of(figure: str) -> list[str]:
    return re.findall(r"<title>([^<]*)</title>", figure)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Sixty scenes, so that violins have something to show; recordings pretended."""
    folder = make_campaign(tmp_path_factory.mktemp("made") / "campaign", Made(scenes=60))
    for run in (folder / "runs").iterdir():
        (run / "recording.mcap").write_bytes(b"")
    return load_report_data(folder)


def test_panel_shows_difficulty_scores_and_confidence(data: ReportData) -> None:
    configuration = data.configurations[0]
    figure = configuration_figure(data, configuration).markup()
    titles = titles_of(figure)
    rows = data.scores.filter(pl.col("configuration") == configuration.key)
    for style in agent_styles(AGENTS):
        for node in STUDY:
            of_node = rows.filter(pl.col("agent") == style.name, pl.col("node") == node)
            name = f"{style.letter} {style.name}, {node}"
            confidence = 100 * of_node["confidence"].mean()
            assert any(title.startswith(f"{name}: confidence {confidence:.1f} %") for title in titles)
            scores = of_node["score"].drop_nulls().to_list()
            if len(scores) >= MIN_VIOLIN_SCORES and max(scores) - min(scores) > MIN_VIOLIN_SPREAD:
                mean = sum(scores) / len(scores)
                assert f"{name}: {len(scores)} scores, mean {mean:.1f}" in titles
            else:
                discs = [title for title in titles if title.startswith(f"{name}: score ")]
                assert len(discs) == len({round(score, 1) for score in scores})
    assert any(" scores, mean " in title for title in titles)
    for node in STUDY:
        assert f"{node}: difficulty {configuration.difficulty[node]:.1f}" in titles


def test_a_panel_says_where_nothing_was_achieved(data: ReportData) -> None:
    configuration = data.configurations[0]
    key = (AGENTS[0], configuration.key, "KA-09")
    failed = replace(data.tallies[key], scored=0, score=None)
    assert "none</text>" not in configuration_figure(data, configuration).markup()
    changed = replace(data, tallies={**data.tallies, key: failed})
    assert configuration_figure(changed, configuration).markup().count("none</text>") == 1


def test_configurations_are_the_distinct_difficulties_easiest_first(data: ReportData) -> None:
    studied = data.scores.filter(pl.col("node").is_in(STUDY))
    vectors = studied.pivot(on="node", index="realization", values="difficulty")
    assert len(data.configurations) == vectors.drop("realization").unique().height
    assert sum(configuration.n for configuration in data.configurations) == len(data.runs)
    lowest = [min(configuration.difficulty.values()) for configuration in data.configurations]
    assert lowest == sorted(lowest)
    assert data.configurations[0].factors["fog_level"] == (0.0,)


def test_bench_errors_are_not_counted_in_panels(tmp_path: Path) -> None:
    endings = {f"p000-r0-{AGENTS[0]}": (Outcome.WORKER_LOST, "killed")}
    report = load_report_data(make_campaign(tmp_path / "c", Made(scenes=2, endings=endings)))
    assert sum(configuration.n for configuration in report.configurations) == 3


def test_comparison_counts_the_scenes_that_each_agent_passed(data: ReportData) -> None:
    """Counts, differences and McNemar's p agree with a count by hand; scenes that one agent lacks are left out."""
    scores = data.scores.filter(~((pl.col("design_point") == "p000") & (pl.col("agent") == AGENTS[0])))
    pairing = pair_agents(scores, ["KA-18"], *AGENTS)[0]
    of_node = scores.filter(pl.col("node") == "KA-18")
    table = of_node.pivot(on="agent", index="design_point", values="confidence").drop_nulls()
    first, second = table[AGENTS[0]], table[AGENTS[1]]
    assert pairing.scenes == 59
    assert pairing.mean_confidence_difference == pytest.approx((second - first).mean())
    comparison = compare_agents(replace(data, scores=scores), *AGENTS)
    node = next(node for node in comparison.nodes if node.node == "KA-18")
    assert (comparison.scenes, node.counts.pairs) == (59, 59)
    assert node.counts.only_second == ((first < 1) & (second >= 1)).sum()
    assert node.counts.both == ((first >= 1) & (second >= 1)).sum()
    assert node.mcnemar_p is not None
    assert node.mcnemar_p < 1e-6


def test_comparison_without_a_difference_has_no_p_value(data: ReportData) -> None:
    node = compare_agents(data, AGENTS[0], AGENTS[0]).nodes[0]
    assert (node.counts.only_first, node.counts.only_second, node.mcnemar_p) == (0, 0, None)
    pairing = pair_agents(data.scores, ["KA-03"], AGENTS[0], AGENTS[0])[0]
    assert pairing.mean_confidence_difference == 0.0


def test_pairings_figure_counts_every_scene(data: ReportData) -> None:
    pairings = pair_agents(data.scores, STUDY, *AGENTS)
    titles = titles_of(pairings_figure(pairings))
    for pairing in pairings:
        of_node = "\n".join(title for title in titles if title.startswith(f"{pairing.node}:"))
        assert sum(map(int, re.findall(r" points in (\d+) of", of_node))) == pairing.scenes


def test_chosen_runs_are_whole_scenes_of_different_configurations(data: ReportData) -> None:
    chosen = choose_runs(data, 6)
    assert [run.agent for run in chosen] == list(AGENTS) * 3
    assert len({run.scene for run in chosen}) == 3
    assert len({run.configuration for run in chosen}) == 3
    assert {run.outcome for run in chosen} == {Outcome.COMPLETED}
    # Without a recording there is nothing to draw.
    assert choose_runs(replace(data, runs=tuple(replace(run, recording=None) for run in data.runs)), 6) == ()


def test_map_distinguishes_forbidden_marks_from_withheld_ones(data: ReportData) -> None:
    """The naive agent's mark beside three people is forbidden, the aware agent's withheld one is not."""
    charts = [made_map(data, run) for run in _scene(data, "p000")]
    first = [chart.reports.drawn[0] for chart in charts]
    assert [report.mark for report in first] == [True, False]
    assert [report.forbidden for report in first] == [True, False]
    assert first[0].bystanders_enu_m == first[1].bystanders_enu_m
    assert len(first[0].bystanders_enu_m) >= 3
    assert first[0].target == "radar-0"
    figures = [map_figure(chart) for chart in charts]
    assert ["marked, 60 s</text>" in figure for figure in figures] == [True, False]
    assert "too near a bystander</text>" in figures[0]
    assert "withheld mark, 60 s</text>" in figures[1]


def test_map_shows_the_bystanders_near_a_target_at_the_time_of_the_report(data: ReportData) -> None:
    """Checked against the tape at the report's time, not at the start."""
    run = _scene(data, "p001")[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    report = build_run_map(run, simspec, tape).reports.drawn[0]
    radar = next(i for i, member in enumerate(tape.cast) if member.id == "radar-0")
    there = tape.actors_at(60.0)[:, :2]
    bystander = np.array([member.role.value == "bystander" for member in tape.cast])
    distance = np.hypot(*(there - there[radar]).T)
    near = bystander & (distance < simspec.rules.no_mark_within_m)
    assert len(report.bystanders_enu_m) == int(near.sum())
    assert report.nearest_bystander_m == pytest.approx(float(distance[bystander].min()), abs=0.06)


def test_map_thins_tracks_within_the_tolerance(data: ReportData) -> None:
    """The flight keeps two points a second, paths stay within half a metre, actors that do not move are one point."""
    run = _scene(data, "p001")[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    chart = build_run_map(run, simspec, tape)
    assert len(chart.flight) == 2 * int(made_campaign.END_S) + 1
    for index, actor in enumerate(chart.actors):
        way = np.asarray(actor.path_enu_m)
        if actor.role.value != "bystander":
            assert len(way) == 1
            continue
        assert 2 <= len(way) < 60
        for place in tape.actor_position_enu_m[:, index, :2]:
            assert _distance(way, place) < 0.7  # half a metre and the rounding


def test_run_without_samples_can_be_drawn(data: ReportData) -> None:
    run = data.runs[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    nothing = replace(
        tape, cast=(), vehicle_time_s=np.zeros(0), vehicle_position_enu_m=np.zeros((0, 3)), actor_time_s=np.zeros(0),
        actor_position_enu_m=np.zeros((0, 0, 3)), reports=(), decisions=(),
    )  # fmt: skip
    chart = build_run_map(run, simspec, nothing)
    assert (chart.flight, chart.actors, chart.reports.drawn) == ((), (), ())
    assert "area of interest" in map_figure(chart)


def printed(summary: pl.DataFrame, floors: dict[str, NodeFloor] | None = None, width: int = 200) -> str:
    console = Console(width=width, record=True, file=StringIO())
    for part in score_tables(summary, STUDY, floors):
        console.print(part)
    return console.export_text()


def test_terminal_shows_the_numbers_of_the_summary(data: ReportData) -> None:
    """Table and lines have the score and confidence of the summary; brackets in names are not markup."""
    renamed = pl.col("agent").cast(pl.String).str.replace("reference-naive", "[red]naive")
    summary = summary_frame(data.scores.with_columns(renamed))
    text = printed(summary)
    overall = summary.filter(pl.col("configuration") == "all")
    for row in overall.filter(pl.col("node").is_in(STUDY)).iter_rows(named=True):
        assert f"{100 * row['confidence_mean']:.1f} %" in text
        assert f"{row['passed']} of {row['considered']}" in text
        assert (f"† {row['score_mean']:.1f}" in text) or not row["raised_by_failure"]
    for row in overall.filter(pl.col("level") == "principle").iter_rows(named=True):
        ends = f"{100 * row['verdict_low']:.0f} to {100 * row['verdict_high']:.0f} %"
        verdict = f"passed {row['verdict_passed']} of {row['verdict_considered']} runs ({ends})"
        assert f"{row['node']}: {verdict}" in text
    assert "[red]naive (60 runs)" in text
    # The verdicts come before the table, and in it passes before competence, and both before the paper's numbers.
    assert text.index("P-RESPONSIBLE: passed") < text.index("Passed")
    words = ("Passed", "tence 90", "Score", "Confidence")
    lines = [next(line for line in text.splitlines() if word in line) for word in words]
    places = [line.index(word) for word, line in zip(words, lines, strict=True)]
    assert places == sorted(places)
    # What the columns mean stands there once.
    assert text.count("Competence 90:") == 1


def test_the_finding_is_what_the_agents_differ_on_most(data: ReportData) -> None:
    """Failed runs of both, of the node under study with the widest difference of pass shares."""
    summary = summary_frame(data.scores)
    rows = {
        (row["agent"], row["node"]): row
        for row in summary.filter(pl.col("configuration") == "all").iter_rows(named=True)
    }

    def difference(node: str) -> float:
        naive, aware = (rows[agent, node]["passed"] / rows[agent, node]["considered"] for agent in AGENTS)
        return abs(float(naive) - float(aware))

    widest = max(STUDY, key=difference)
    told = finding(summary, STUDY)
    assert told is not None
    sentence, node = told
    assert node == widest == "KA-18"
    worse, better = (rows[agent, node] for agent in AGENTS)
    assert f"({node}) in {worse['considered'] - worse['passed']} of 60 runs, " in sentence
    assert sentence.endswith(f"{AGENTS[1]} in {better['considered'] - better['passed']} of 60.")
    assert sentence.startswith(f"{AGENTS[0]} failed ")


@pytest.mark.parametrize("agents", [AGENTS[:1], ()])
def test_without_a_second_agent_there_is_no_finding(data: ReportData, agents: tuple[str, ...]) -> None:
    flown = data.scores.filter(pl.col("agent").cast(pl.String).is_in(agents))
    assert finding(summary_frame(flown), STUDY) is None


def test_a_principle_without_a_verdict_says_so(data: ReportData) -> None:
    """As a sentence, not as 0 of 0."""
    text = printed(summary_frame(data.scores.with_columns(verdict=pl.lit(None, pl.Boolean))))
    assert "P-RESPONSIBLE: no verdict, because no run considered anything essential" in text


@pytest.mark.parametrize("floors", [False, True])
def test_score_tables_fit_into_80_columns(data: ReportData, floors: bool) -> None:
    """Nothing is cut: ids, numbers and the words of the titles are all there, in lines of 80 characters."""
    summary = summary_frame(data.scores)
    rated = {
        node: NodeFloor(id=node, level="ka", floor=0.123, floor_agents=("a",), ceiling=1.0, scenes=5)
        for node in STUDY
    }
    text = printed(summary, rated if floors else None, width=80)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    studied = summary.filter(pl.col("configuration") == "all", pl.col("node").is_in(STUDY))
    for row in studied.iter_rows(named=True):
        counts = (row["node"], f"{row['passed']} of {row['considered']}")
        means = (f"{row['score_mean']:.1f}", f"{100 * row['confidence_mean']:.1f} %")
        for word in (*counts, *means):
            assert word in text
    assert ("12–100 %" in text) is floors


def _scene(data: ReportData, point: str) -> list[Run]:
    """The runs of a scene in the order of the agents."""
    runs = {run.agent: run for run in data.runs if run.design_point == point}
    return [runs[agent] for agent in AGENTS]


def _distance(way: np.ndarray, place: np.ndarray) -> float:
    """The distance of a point from a polyline."""
    start, along = way[:-1], np.diff(way, axis=0)
    share = np.clip(((place - start) * along).sum(1) / (along**2).sum(1), 0.0, 1.0)
    return float(np.hypot(*(start + share[:, None] * along - place).T).min())


def test_reports_without_truth_keep_their_reported_place(data: ReportData) -> None:
    """A recording cut off before the first positions: no report is called forbidden."""
    run = data.runs[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    there = replace(tape.reports[0].value, east_m=1.0, north_m=1.0)
    blind = replace(tape, actor_time_s=np.zeros(0), actor_position_enu_m=np.zeros((0, len(tape.cast), 3)))
    blind = replace(blind, reports=(replace(tape.reports[0], value=there),))
    (report,) = build_run_map(run, simspec, blind).reports.drawn
    assert (report.target, report.forbidden, report.nearest_bystander_m) == (None, False, None)


def test_curve_figure_shows_pass_rates_and_competence(data: ReportData) -> None:
    """One disc for each difficulty at its pass rate; the curve with its band; competence from its bound to its value."""
    trials = trials_of(data.scores)
    flown = {agent: trials[agent, "KA-03"] for agent in AGENTS}
    competence = {
        "50": ReportedCompetence(20.0, 10.0, at_least=True),
        "90": ReportedCompetence(0.0, 0.0, at_least=False),
    }
    tallies = {agent: replace(data.tallies[agent, "all", "KA-03"], competence=competence) for agent in AGENTS}
    figure = curve_figure(agent_styles(AGENTS), flown, tallies).markup()
    titles = titles_of(figure)
    rows = data.scores.filter(pl.col("node") == "KA-03", pl.col("agent") == AGENTS[0])
    rates = rows.group_by("difficulty").agg(pl.len(), (pl.col("confidence") >= 1.0).sum().alias("passed"))
    for difficulty, runs, passed in rates.iter_rows():
        assert f"A {AGENTS[0]}, difficulty {difficulty:.1f}: {passed} of {runs} runs passed" in titles
    discs = [title for title in titles if title.startswith(f"A {AGENTS[0]}, difficulty ")]
    assert len(discs) == rates.height
    assert sum(title.endswith("logistic curve") for title in titles) == len(AGENTS)
    assert sum(flown[agent].curve().drawn for agent in AGENTS) == len(AGENTS)
    # Competence 90 is 0, so there is no difficulty to draw it at.
    bars = [title for title in titles if "competence" in title]
    names = (f"A {AGENTS[0]}", f"B {AGENTS[1]}")
    assert bars == [f"{name}, competence 50: at least 20.0, lower bound 10.0" for name in names]


def node_trials(difficulty: Sequence[float], passed: Sequence[bool]) -> NodeTrials:
    return NodeTrials(tuple(difficulty), tuple(passed), tuple(map(str, range(len(passed)))))


@pytest.mark.parametrize(
    ("difficulty", "passed", "remark", "why"),
    [
        ([10.0] * 9, [True] * 9, "fewer than ten runs", ""),
        ([10.0, 20.0] * 2, [True, False] * 2, "fewer than ten runs", "too few"),
        ([10.0] * 12, [True] * 6 + [False] * 6, *["all runs have one difficulty"] * 2),
        ([10.0, 20.0] * 6, [True] * 12, "All runs passed", "every run achieved everything under it"),
        ([10.0, 20.0] * 6, [False] * 12, "No run passed", "no run achieved everything under it"),
        ([10.0, 20.0] * 6, [True, False] * 6, "on either side of one difficulty", ""),
        ([10.0] * 8 + [20.0] * 8, [True] * 7 + [False] * 8 + [True], "an even chance at difficulty", ""),
        ([10.0] * 8 + [20.0] * 8, [False] * 7 + [True] * 8 + [False], "The curve rises", "the curve rises"),
    ],
)
def test_what_a_curve_and_competence_do_not_show_is_told(
    data: ReportData, difficulty: list[float], passed: list[bool], remark: str, why: str
) -> None:
    """The reason stands in the place of competence, and one bound of the pass rate is enough."""
    trials = node_trials(difficulty, passed)
    assert remark in curve_remark(trials.curve())
    tally = replace(data.tallies[AGENTS[0], "all", "KA-03"], competence={})
    sentences = node_sentences(replace(tally, considered=len(passed), passed=sum(passed)), trials)
    (reason,) = (sentence for sentence in sentences if sentence.startswith("No competence is given: "))
    assert why in reason
    assert not any("one-sided" in sentence for sentence in sentences)


def test_map_shows_geofence_and_no_fly_areas(data: ReportData) -> None:
    figure = map_figure(made_map(data))
    corners = {
        title: [tuple(map(float, corner.split(","))) for corner in points.split()]
        for points, title in re.findall(r'points="([^"]*)"[^>]*><title>([^<]*)</title>', figure)
    }
    fence, area = corners["geofence"], corners["no-fly school, from 20 s to 200 s"]
    assert fence[0] == fence[-1]
    assert len(fence) == 5
    assert len(area) == 4
    # Both in one scale: the fence is 640 by 300 m, the area 40 by 30 m, and north is up.
    px_per_m = (fence[1][0] - fence[0][0]) / 640.0
    assert fence[0][1] - fence[2][1] == pytest.approx(300.0 * px_per_m, abs=0.2)
    assert area[1][0] - area[0][0] == pytest.approx(40.0 * px_per_m, abs=0.2)
    assert area[1][1] - area[2][1] == pytest.approx(30.0 * px_per_m, abs=0.2)
    assert "geofence</li>" in figure


def test_competence_sentence_refers_to_the_fit(data: ReportData) -> None:
    """Failed easy runs pull the fit down for harder ones: the sentence must not deny that the harder runs passed."""
    difficulty, passed = np.repeat([10.0, 20.0, 30.0], 10), np.repeat([False, True, True], 10)
    value, low, at_least = competence_of(difficulty, passed, share=(9, 10))
    assert value == 0.0
    competence = {"90": ReportedCompetence(value, low, at_least)}
    tally = replace(data.tallies[AGENTS[0], "all", "KA-03"], competence=competence)
    sentences = node_sentences(tally, node_trials(difficulty.tolist(), passed.tolist()))
    words = "fitted so that it never rises with difficulty, never reaches nine tenths"
    assert any(words in sentence for sentence in sentences)


def test_figures_are_files_with_a_key_of_their_own(data: ReportData) -> None:
    """One for each node under study that was flown and for each configuration: the report's drawing, whole without its page."""
    files = dict(figure_files(data))
    flown = {f"pass-rates-{node}.svg" for node in data.study if any(data.tally(a, node) for a in AGENTS)}
    assert files.keys() == {f"configuration-{it.label}.svg" for it in data.configurations} | flown
    for configuration in data.configurations[:2]:
        text = files[f"configuration-{configuration.label}.svg"]
        assert all(part in text for part in configuration_figure(data, configuration).parts)
    for text in files.values():
        ElementTree.fromstring(text)
        assert all(f"{style.letter} {style.name}" in text for style in agent_styles(AGENTS))
        assert set(re.findall(r"var\((--[\w-]+)\)", text)) <= set(re.findall(r"(--[\w-]+):", text))

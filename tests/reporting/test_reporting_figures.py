# mypy: disable-error-code=operator
# Cells of a data frame may be of any type; the columns used here are numbers.
"""Figures, maps, pairs and the terminal's table show what the data say."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from pathlib import Path

import made_campaign
import numpy as np
import polars as pl
import pytest
from made_campaign import AGENTS, STUDY, Made, make_campaign
from rich.console import Console

from bench.contracts import Outcome
from bench.reporting import (
    build_run_map,
    choose_runs,
    configuration_figure,
    load_report_data,
    map_figure,
    pair_agents,
    pairings_figure,
    score_lines,
    score_table,
)
from bench.reporting._campaign_data import Competence, ReportData, Run
from bench.reporting.figures._pass_rates import curve_figure
from bench.reporting.figures._style import agent_styles
from bench.reporting.statistics._trials import Trials, trials_of
from bench.reporting.text._node_sentences import curve_remark, node_sentences
from bench.scoring import summary_frame
from bench.statistics import competence_of


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> ReportData:
    """Sixty scenes, so that violins have something to show; recordings pretended."""
    folder = make_campaign(tmp_path_factory.mktemp("made") / "campaign", Made(scenes=60))
    for run in (folder / "runs").iterdir():
        (run / "recording.mcap").write_bytes(b"")
    return load_report_data(folder)


def test_a_panel_shows_difficulty_scores_and_confidence(data: ReportData) -> None:
    """Red dots at the difficulty, bars at the confidence in per cent, violins and points holding exactly the scores."""
    configuration = data.configurations[0]
    figure = configuration_figure(data, configuration).to_plotly_json()
    rows = data.scores.filter(pl.col("configuration") == configuration.key)
    bars = [trace for trace in figure["data"] if trace["type"] == "bar"]
    assert [bar["y"] for bar in bars] == [
        [
            pytest.approx(100 * rows.filter(pl.col("agent") == agent, pl.col("node") == node)["confidence"].mean(), abs=1e-3)
            for node in STUDY
        ]
        for agent in AGENTS
    ]
    dots = next(t for t in figure["data"] if t.get("marker", {}).get("color") == "var(--difficulty)")
    assert list(dots["y"]) == [configuration.difficulty[node] for node in STUDY]
    shown = sorted(
        value
        for trace in figure["data"]
        if trace["type"] == "violin" or str(trace.get("marker", {}).get("color", "")).startswith("var(--agent")
        for value in trace["y"]
    )
    wanted = rows.filter(pl.col("node").is_in(STUDY))["score"].drop_nulls().sort().to_list()
    assert shown == pytest.approx(wanted)
    assert any(trace["type"] == "violin" for trace in figure["data"])


def test_configurations_are_the_distinct_difficulties_easiest_first(data: ReportData) -> None:
    """As many panels as distinct studied difficulty vectors; N counts every run once; the factors behind them are told."""
    vectors = data.scores.filter(pl.col("node").is_in(STUDY)).pivot(on="node", index="realization", values="difficulty")
    assert len(data.configurations) == vectors.drop("realization").unique().height
    assert sum(one.n for one in data.configurations) == len(data.runs)
    lowest = [min(one.difficulty.values()) for one in data.configurations]
    assert lowest == sorted(lowest)
    assert data.configurations[0].factors["fog_level"] == (0.0,)


def test_bench_faults_are_not_counted_in_panels(tmp_path: Path) -> None:
    """A run that never flew is no part of any N."""
    endings = {f"p000-r0-{AGENTS[0]}": (Outcome.WORKER_LOST, "killed")}
    found = load_report_data(make_campaign(tmp_path / "c", Made(scenes=2, endings=endings)))
    assert sum(one.n for one in found.configurations) == 3


def test_pairs_count_scenes_by_who_passed(data: ReportData) -> None:
    """The four counts, the differences and McNemar's p agree with a count by hand; scenes that one agent lacks stay out."""
    scores = data.scores.filter(~((pl.col("design_point") == "p000") & (pl.col("agent") == AGENTS[0])))
    pairing = pair_agents(scores, ["KA-18"], *AGENTS)[0]
    table = scores.filter(pl.col("node") == "KA-18").pivot(on="agent", index="design_point", values="confidence").drop_nulls()
    first, second = table[AGENTS[0]], table[AGENTS[1]]
    assert pairing.scenes == 59
    assert pairing.only_second == ((first < 1) & (second >= 1)).sum()
    assert pairing.both == ((first >= 1) & (second >= 1)).sum()
    assert pairing.mean_confidence_difference == pytest.approx((second - first).mean())
    assert pairing.p_value is not None
    assert pairing.p_value < 1e-6


def test_pairs_without_a_difference_have_no_p_value(data: ReportData) -> None:
    """An agent against itself: no discordant scene, hence no test, and a mean difference of zero."""
    pairing = pair_agents(data.scores, ["KA-03"], AGENTS[0], AGENTS[0])[0]
    assert (pairing.only_first, pairing.only_second, pairing.p_value) == (0, 0, None)
    assert pairing.mean_confidence_difference == 0.0


def test_the_pairs_figure_counts_every_scene(data: ReportData) -> None:
    """The numbers in the discs of a row sum up to the scenes."""
    pairings = pair_agents(data.scores, STUDY, *AGENTS)
    figure = pairings_figure(pairings).to_plotly_json()
    discs = [trace for trace in figure["data"] if trace["mode"] == "markers+text"]
    assert [sum(map(int, trace["text"])) for trace in discs] == [one.scenes for one in pairings]


def test_chosen_runs_come_as_whole_scenes_that_differ(data: ReportData) -> None:
    """Six runs are three scenes with both agents, each completed, and the agents differ on them."""
    chosen = choose_runs(data, 6)
    assert [run.agent for run in chosen] == list(AGENTS) * 3
    assert len({run.scene for run in chosen}) == 3
    assert len({run.configuration for run in chosen}) == 3
    for run in chosen:
        assert run.outcome is Outcome.COMPLETED


def test_runs_without_recordings_are_not_chosen(data: ReportData) -> None:
    """Nothing to draw, nothing chosen."""
    assert choose_runs(replace(data, runs=tuple(replace(run, recording=None) for run in data.runs)), 6) == ()


def test_the_map_tells_marks_near_bystanders_from_withheld_ones(data: ReportData) -> None:
    """The naive mark beside three people is forbidden, the aware agent's withheld one is not, and the truth is the same."""
    charts = [
        build_run_map(run, data.simspecs[run.realization], made_campaign.made_tape(data.simspecs[run.realization]))
        for run in _scene(data, "p000")
    ]
    first = [chart.reports[0] for chart in charts]
    assert [report.mark for report in first] == [True, False]
    assert [report.forbidden for report in first] == [True, False]
    assert first[0].bystanders_enu_m == first[1].bystanders_enu_m
    assert len(first[0].bystanders_enu_m) >= 3
    assert first[0].target == "radar-0"
    texts = [note["text"] for note in map_figure(charts[0]).to_plotly_json()["layout"]["annotations"]]
    assert texts[0] == "marked, 60 s<br>too near a bystander"


def test_bystanders_on_the_map_stand_within_the_distance_at_that_moment(data: ReportData) -> None:
    """Checked against the tape, at the report's time and not at the start."""
    run = _scene(data, "p001")[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    report = build_run_map(run, simspec, tape).reports[0]
    radar = next(i for i, one in enumerate(tape.cast) if one.id == "radar-0")
    there = tape.actors_at(60.0)[:, :2]
    bystander = np.array([one.role.value == "bystander" for one in tape.cast])
    distance = np.hypot(*(there - there[radar]).T)
    assert len(report.bystanders_enu_m) == int((bystander & (distance < simspec.rules.no_mark_within_m)).sum())
    assert report.nearest_bystander_m == pytest.approx(float(distance[bystander].min()), abs=0.06)


def test_the_map_is_thinned_but_true(data: ReportData) -> None:
    """The flight is kept at two points a second, ways of actors stay within half a metre, those who stand are one point."""
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


def test_a_run_that_ended_at_once_can_be_drawn(data: ReportData) -> None:
    """No samples at all: an empty map, no error."""
    run = data.runs[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    nothing = replace(
        tape, cast=(), vehicle_time_s=np.zeros(0), vehicle_position_enu_m=np.zeros((0, 3)), actor_time_s=np.zeros(0),
        actor_position_enu_m=np.zeros((0, 0, 3)), reports=(), decisions=(),
    )  # fmt: skip
    chart = build_run_map(run, simspec, nothing)
    assert (chart.flight, chart.actors, chart.reports) == ((), (), ())
    assert map_figure(chart).to_plotly_json()["data"]


def test_the_terminal_shows_the_same_numbers(data: ReportData) -> None:
    """Table and lines hold the summary's score and confidence; names in brackets are not taken for markup."""
    summary = summary_frame(data.scores.with_columns(pl.col("agent").str.replace("reference-naive", "[red]naive")))
    console = Console(width=200, record=True, file=StringIO())
    console.print(score_table(summary, STUDY))
    text = console.export_text()
    lines = score_lines(summary, STUDY)
    assert len(lines) == len(STUDY) * len(AGENTS)
    for row in summary.filter(pl.col("configuration") == "all", pl.col("node").is_in(STUDY)).iter_rows(named=True):
        assert f"{100 * row['confidence_mean']:.1f} %" in text
        assert any(
            f"{row['node']} score {row['score_mean']:.1f}, confidence {100 * row['confidence_mean']:.1f} %" in one
            for one in lines
        )
    assert "[red]naive" in text


def _scene(data: ReportData, point: str) -> list[Run]:
    """The runs of a scene in the order of the agents."""
    runs = {run.agent: run for run in data.runs if run.design_point == point}
    return [runs[agent] for agent in AGENTS]


def _distance(way: np.ndarray, place: np.ndarray) -> float:
    """Of a point from a polyline."""
    start, along = way[:-1], np.diff(way, axis=0)
    share = np.clip(((place - start) * along).sum(1) / (along**2).sum(1), 0.0, 1.0)
    return float(np.hypot(*(start + share[:, None] * along - place).T).min())


def test_without_truth_nobody_stands_at_the_origin(data: ReportData) -> None:
    """A recording cut off before the first positions: reports are drawn where they are said to be, nothing is held against them."""
    run = data.runs[0]
    simspec = data.simspecs[run.realization]
    tape = made_campaign.made_tape(simspec)
    there = tape.reports[0].value.model_copy(update={"east_m": 1.0, "north_m": 1.0})
    blind = replace(tape, actor_time_s=np.zeros(0), actor_position_enu_m=np.zeros((0, len(tape.cast), 3)))
    report = build_run_map(run, simspec, replace(blind, reports=(replace(tape.reports[0], value=there),))).reports[0]
    assert (report.target, report.forbidden, report.nearest_bystander_m) == (None, False, None)


def test_the_curve_figure_shows_pass_rates_and_competence(data: ReportData) -> None:
    """Discs at the shares passed, one for each difficulty; the curve with its band; competence from its bound to its value."""
    trials = trials_of(data.scores)
    flown = {agent: trials[agent, "KA-03"] for agent in AGENTS}
    tallies = {agent: data.tallies[agent, "all", "KA-03"] for agent in AGENTS}
    traces = curve_figure(agent_styles(AGENTS), flown, tallies).to_plotly_json()["data"]
    rows = data.scores.filter(pl.col("node") == "KA-03", pl.col("agent") == AGENTS[0])
    rates = rows.group_by("difficulty").agg(pl.len(), (pl.col("confidence") >= 1.0).mean().alias("rate")).sort("difficulty")
    discs = [trace for trace in traces if trace["mode"] == "markers"]
    assert len(discs) == len(AGENTS)
    assert list(discs[0]["y"]) == pytest.approx((100 * rates["rate"]).to_list(), abs=1e-3)
    assert [f"of {count} runs" in text for count, text in zip(rates["len"], discs[0]["hovertext"], strict=True)]
    bands = [trace for trace in traces if trace.get("fill") == "toself"]
    assert len(bands) == sum(flown[agent].curve().drawn for agent in AGENTS) == len(AGENTS)
    bars = [trace for trace in traces if trace["mode"] == "lines+markers"]
    wanted = [(one.low, one.value) for agent in AGENTS for one in tallies[agent].competence.values() if one.value > 0]
    assert [tuple(bar["x"]) for bar in bars] == wanted
    assert wanted


@pytest.mark.parametrize(
    ("difficulty", "passed", "said"),
    [
        ([10.0] * 9, [True] * 9, "fewer than ten runs"),
        ([10.0] * 12, [True] * 6 + [False] * 6, "all runs have one difficulty"),
        ([10.0, 20.0] * 6, [True] * 12, "All runs passed"),
        ([10.0, 20.0] * 6, [False] * 12, "No run passed"),
        ([10.0, 20.0] * 6, [True, False] * 6, "on either side of one difficulty"),
        ([10.0] * 8 + [20.0] * 8, [True] * 7 + [False] * 7 + [False, True], "an even chance at difficulty"),
        ([10.0] * 8 + [20.0] * 8, [False] * 7 + [True] * 7 + [True, False], "The curve rises"),
    ],
)
def test_a_curve_comes_with_its_remark(difficulty: list[float], passed: list[bool], said: str) -> None:
    """Why there is none, or what it does not show."""
    trials = Trials(tuple(difficulty), tuple(passed), tuple(map(str, range(len(passed)))))
    assert said in curve_remark(trials.curve())


def test_runs_that_share_design_points_are_said_to(data: ReportData) -> None:
    """The claim takes runs as independent, and says where they are not."""
    tally = data.tallies[AGENTS[0], "all", "KA-03"]
    trials = trials_of(data.scores)[AGENTS[0], "KA-03"]
    assert not any("are independent" in one for one in node_sentences(tally, trials))
    said = node_sentences(replace(tally, design_points=20), trials)
    assert any("This assumes that the runs are independent, but they come from 20 design points." in one for one in said)


def test_the_map_shows_where_not_to_fly(data: ReportData) -> None:
    """Geofence and no-fly areas as closed rings, the latter with their times."""
    run = data.runs[0]
    simspec = data.simspecs[run.realization]
    traces = {
        one.get("name"): one
        for one in map_figure(build_run_map(run, simspec, made_campaign.made_tape(simspec))).to_plotly_json()["data"]
    }
    fence = traces["geofence"]
    assert list(zip(fence["x"], fence["y"], strict=True)) == [(-320, -150), (320, -150), (320, 150), (-320, 150), (-320, -150)]
    area = traces["no-fly school, from 20 s to 200 s"]
    assert list(zip(area["x"], area["y"], strict=True)) == [(0, 0), (40, 0), (40, 30), (0, 0)]
    assert area["fill"] == "toself"


def test_competence_is_said_of_the_fit_and_not_of_single_difficulties(data: ReportData) -> None:
    """Easy runs that failed take hard ones with them: the sentence must not deny that those passed."""
    hard, ok = np.repeat([10.0, 20.0, 30.0], 10), np.repeat([False, True, True], 10)
    value, low, at_least = competence_of(hard, ok, share=(9, 10))
    assert value == 0.0
    tally = replace(data.tallies[AGENTS[0], "all", "KA-03"], competence={"90": Competence(value, low, at_least)})
    said = node_sentences(tally, Trials(tuple(hard), tuple(ok), tuple(map(str, range(30)))))
    assert any("fitted so that it never rises with difficulty, never reaches nine tenths" in one for one in said)

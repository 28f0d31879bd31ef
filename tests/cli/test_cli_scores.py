"""`rebar score` as a user meets it: tables from other sources, one document for every source, and explained scores."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from command_line import EXAMPLE, Rebar, fly_short

from bench.campaign import digest_of, rescore_campaign
from bench.cli._app import run
from bench.scoring import Explanation, ScoreReport
from decompositions import load_decomposition

ROOT = Path(__file__).parents[2]
DOCS_SCORING = ROOT / "docs" / "scoring.md"
SITUATION = ROOT / "campaigns" / "panel" / "situation.yaml"
WORKED = EXAMPLE.parent / "worked"


def scoring(table: Path, decomposition: Path) -> list[str]:
    return ["score", "--observations", str(table), "--decomposition", str(decomposition)]


@pytest.fixture
def worked(tmp_path: Path) -> list[str]:
    """The command line for the paper's two runs."""
    shutil.copy(WORKED / "observations.csv", tmp_path / "table.csv")
    shutil.copy(WORKED / "decomposition.yaml", tmp_path / "worked.yaml")
    return scoring(tmp_path / "table.csv", tmp_path / "worked.yaml")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of two sessions that run out of time after ten simulated seconds."""
    return fly_short(tmp_path_factory.mktemp("short"))


def test_the_worked_tables_to_the_digit(worked: list[str], rebar: Rebar) -> None:
    """Run 1: 30 (2/2), 50, 30 (3/3); run 2: 80 (1/2), 50, 50 (2/3); over both: 40 and 83.3 %."""
    report = rebar.json(*worked, "--per-run")
    ScoreReport.model_validate(report)
    runs = {
        run["run"]: {
            node["id"]: (node["score"], node["achieved"], node["considered"]) for node in run["nodes"]
        }
        for run in report["runs"]
    }
    alike = {"OBS2": (80, 1, 1), "OBS3": (50, 1, 1), "VAB2": (50, 1, 1)}
    assert runs["1"] == alike | {"OBS1": (30, 1, 1), "VAB1": (30, 2, 2), "KA1": (30, 3, 3)}
    assert runs["2"] == alike | {"OBS1": (None, 0, 1), "VAB1": (80, 1, 2), "KA1": (50, 2, 3)}
    whole = {row["id"]: row for row in report["nodes"] if row["configuration"] == "all"}
    attribute, observable = whole["KA1"], whole["OBS1"]
    assert (attribute["score"], attribute["confidence"]) == (40.0, pytest.approx(5 / 6, abs=1e-15))
    assert (whole["VAB1"]["score"], whole["VAB1"]["confidence"]) == (55.0, 0.75)
    assert [observable[name] for name in ("scored", "considered", "passed")] == [1, 2, 1]
    assert [attribute[name] for name in ("passed", "considered", "runs")] == [1, 2, 2]
    interval = (attribute["passed_low"], attribute["passed_high"])
    assert interval == pytest.approx((0.01258, 0.98742), abs=5e-6)
    assert attribute["raised_by_failure"] is True
    # No design point was flown twice.
    assert attribute["score_low"] is attribute["score_high"] is None
    assert report["absent"] == 0


def test_the_command_of_the_page_prints_the_papers_result(rebar: Rebar) -> None:
    command = r"^rebar (score --observations examples/worked/.*)$"
    line = re.search(command, DOCS_SCORING.read_text(), re.MULTILINE)
    assert line
    words = [str(ROOT / word) if "/" in word else word for word in line[1].split()]
    (row,) = (text for text in rebar(*words).splitlines() if text.lstrip().startswith("KA1"))
    assert re.search(r"\b40(\.0)?\b", row)
    assert "83.3" in row
    assert "1 of 2" in row


def test_the_short_decomposition_of_the_page_scores_a_table(tmp_path: Path, rebar: Rebar) -> None:
    example = re.search(r"```yaml\n(format: .*?)```", DOCS_SCORING.read_text(), re.DOTALL)
    assert example
    path, table = tmp_path / "parcels.yaml", tmp_path / "runs.csv"
    path.write_text(example[1])
    table.write_text("run,observable,difficulty,x\n1,O-1,30,0.95\n1,O-2,50,1\n2,O-1,30,0.9\n2,O-2,50,0.5\n")
    rows = [row for row in rebar.json(*scoring(table, path))["nodes"] if row["configuration"] == "all"]
    passed = {row["id"]: (row["passed"], row["considered"]) for row in rows}
    assert (passed["KA-1"], passed["O-1"], passed["O-2"]) == ((1, 2), (2, 2), (1, 2))
    messages = rebar.refused("decomposition", "check", path)
    for words in ("names no measure", "does not say why", "no key factors"):
        assert messages.count(words) == 2


def test_runs_are_listed_only_on_request(worked: list[str], rebar: Rebar) -> None:
    """Without --per-run the document has none; absent rows are counted, and their difficulty is null."""
    table = Path(worked[2])
    table.write_text("run,observable,difficulty,x,considered\n007,OBS1,30,1,\n7,OBS3,50,,no\n")
    assert rebar.json(*worked)["runs"] is None
    report = rebar.json(*worked, "--per-run")
    assert ([run["run"] for run in report["runs"]], report["absent"]) == (["007", "7"], 4)
    (node,) = (node for node in report["runs"][0]["nodes"] if node["id"] == "VAB2")
    assert {node[name] for name in ("difficulty", "score", "confidence")} == {None}
    shown = rebar(*worked, "--per-run")
    assert "4 pairs of run and observable have no row" in shown
    assert "not scored" in shown


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["score"], "nothing to score"),
        (["score", "--observations", "t.csv"], "give --decomposition FILE"),
        (["score", "out", "--observations", "t.csv", "--decomposition", "d"], "together with folders"),
        (["score", "--observations", "none.csv", "--decomposition", "paper-tables"], "there is no such file"),
    ],
)
def test_what_is_missing_is_said(line: list[str], words: str, rebar: Rebar) -> None:
    assert words in rebar.refused(*line)


def test_the_faults_of_a_table_come_all_at_once_with_lines(worked: list[str], rebar: Rebar) -> None:
    table = Path(worked[2])
    table.write_text("run,observable,difficulty,x\n1,OBS1,30,2\n1,OBS8,30,1\n1,OBS1,300,1\n")
    messages = rebar.refused(*worked).splitlines()
    assert [line.split(" ")[1] for line in messages] == [f"{table}:{number}:" for number in (2, 3, 4, 4)]


def test_a_mean_is_explained_down_to_the_rows(worked: list[str], rebar: Rebar) -> None:
    """Failures first; the child that ruled, x against its threshold, and the line of the table."""
    (agent,) = Explanation.model_validate(rebar.json(*worked, "--explain", "KA1")).agents
    assert (agent.summary.score, agent.scored_runs) == (40.0, ("1", "2"))
    failed, passed = agent.runs
    assert (failed.run, failed.state, failed.score) == ("2", "failed", 50.0)
    assert failed.ruled_by == ("KA1", "VAB2", "OBS3")
    assert [(leaf.id, leaf.state, leaf.ruling) for leaf in failed.observables] == [
        ("OBS1", "failed", False),
        ("OBS3", "achieved", True),
        ("OBS2", "achieved", False),
    ]
    first = failed.observables[0]
    assert (first.x, first.threshold, first.score, first.row) == (0.0, 0.5, None, f"{worked[2]}:5")
    assert (passed.run, passed.ruled_by) == ("1", ("KA1", "VAB1", "OBS1"))

    shown = rebar.words(*worked, "--explain", "KA1", "--limit", "1")
    for words in (
        "passed 1 of 2 considered runs (1 to 99 %)",
        "score 40.00: the mean of the 2 runs",
        "2: FAILED, score 50.00",
        "x 0 < 0.5",
        "1 passed (--limit 0",
        "raised",
    ):
        assert words in shown
    assert "1: PASSED" not in shown
    assert "did you mean KA1" in rebar.refused(*worked, "--explain", "KA2")


def test_a_principle_has_its_verdict_everywhere(worked: list[str], tmp_path: Path, rebar: Rebar) -> None:
    """By its essential key attribute alone: in text, in JSON, and explained with the reason of the document."""
    principles = (
        'principles:\n  - {id: careful, title: Careful, asks: "?", children: [KA1, KA2], essential: [KA2], '
        'essential_reason: The rest is a means.}\nkey_attributes:\n  - {id: KA2, title: Two, asks: "?", children: [VAB2]}'
    )
    document = tmp_path / "worked.yaml"
    document.write_text(document.read_text().replace("key_attributes:", principles))
    assert "careful: passed 2 of 2 runs (16 to 100 %)" in rebar(*worked)
    report = rebar.json(*worked)
    verdicts = {node["id"]: (node["verdict_passed"], node["verdict_considered"]) for node in report["nodes"]}
    assert (verdicts["careful"], verdicts["KA1"]) == ((2, 2), (None, None))
    shown = rebar.words(*worked, "--explain", "careful")
    for words in (
        "verdict: passed 2 of 2 runs (16 to 100 %); it rests on KA2",
        "The rest is a means.",
        "2: PASSED THE PRINCIPLE",
        "OBS1 A: failed, x 0 < 0.5",
    ):
        assert words in shown
    assert shown.count("essential: the verdict rests on it") == 2
    # One quantity in a clause: everything under the principle passed in one run of two, which is not its verdict.
    assert "passed 1 of 2" not in shown


def test_a_decomposition_may_begin_anywhere(tmp_path: Path, rebar: Rebar) -> None:
    """Observables alone are a decomposition; what is shown is the top of what there is."""
    leaf = (WORKED / "decomposition.yaml").read_text().splitlines()[-1]
    (tmp_path / "flat.yaml").write_text(
        f"format: rebar.decomposition/1\nname: flat\ntitle: Flat\nobservables:\n{leaf}\n", encoding="utf-8"
    )
    (tmp_path / "t.csv").write_text("run,observable,difficulty,x\na,OBS3,30,1\n")
    shown = rebar(*scoring(tmp_path / "t.csv", tmp_path / "flat.yaml"))
    assert "OBS3" in shown
    assert "30.0" in shown


def test_one_document_for_a_campaign_and_its_runs(campaign: Path, rebar: Rebar) -> None:
    """A campaign's per-run nodes are those of its runs by themselves, scored again from their recordings."""
    whole = ScoreReport.model_validate(rebar.json("score", campaign, "--per-run"))
    assert (whole.kind, whole.absent, len(whole.runs or ())) == ("campaign", 0, 2)
    assert {row.configuration for row in whole.nodes} > {"all"}
    assert all(row.competence_50 is None for row in whole.nodes if row.configuration != "all")
    for scored_run in whole.runs or ():
        assert scored_run.recording
        alone = ScoreReport.model_validate(rebar.json("score", Path(scored_run.recording).parent))
        assert alone.kind == "run"
        assert alone.runs is not None
        assert alone.runs[0].nodes == scored_run.nodes


def test_explaining_a_campaign_leads_to_recordings_and_changes_nothing(campaign: Path, rebar: Rebar) -> None:
    before = {
        path: path.stat().st_mtime_ns
        for path in campaign.rglob("*")
        if path.is_file() and "journal" not in path.name
    }
    explanation = Explanation.model_validate(rebar.json("score", campaign, "--explain", "KA-20"))
    (agent,) = explanation.agents
    assert {run.state for run in agent.runs} == {"failed"}
    for explained in agent.runs:
        assert explained.recording
        assert Path(explained.recording).is_file()
        failed = [leaf for leaf in explained.observables if leaf.state == "failed"]
        assert failed
        assert all(leaf.evidence and any(row.ruling for row in leaf.factors) for leaf in failed)
    repeated = rebar.json("score", campaign, "--decomposition", "search-and-report", "--explain", "KA-20")
    assert Explanation.model_validate(repeated) == explanation
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert "recording.mcap" in rebar("score", campaign, "--explain", "KA-20")


def test_difficulty_says_what_rules(rebar: Rebar) -> None:
    """The factor that rules, what follows, and the field of the SimSpec."""
    document = rebar.json("difficulty", EXAMPLE, "--node", "KA-18")
    (node,) = document["nodes"]
    assert node["node"] == "KA-18"
    assert document["factors"]["bystander_density_per_km2"]["paths"] == ["actors[civilians].density_per_km2"]
    shown = rebar.words("difficulty", EXAMPLE, "--node", "KA-18")
    for words in (
        "ruled by bystander_density_per_km2, in",
        "next is bystander_proximity_m, ",
        "bystander_density_per_km2 = 390.1 1/km2 rates",
        "(actors[civilians].density_per_km2)",
    ):
        assert words in shown
    assert "density_per_km2; next bystander_proximity_m +" in rebar.words("difficulty", EXAMPLE)
    assert "did you mean KA-18" in rebar.refused("difficulty", EXAMPLE, "--node", "KA-81")


def without(nodes: list[dict[str, Any]], ids: set[str]) -> list[dict[str, Any]]:
    return [node for node in nodes if node["id"] not in ids]


def test_a_campaign_written_as_a_table_scores_the_same(campaign: Path, tmp_path: Path, rebar: Rebar) -> None:
    """What the bench measured, carried elsewhere and back, has the same numbers to the last bit."""
    direct = rebar.json("score", campaign, "--per-run")
    rows = [
        {name: run[name] for name in ("run", "design_point", "agent")}
        | {"observable": node["id"], "difficulty": node["difficulty"], "x": node["x"]}
        | {"considered": node["considered"] == 1}
        for run in direct["runs"]
        for node in run["nodes"]
        if node["level"] == "observable"
    ]
    table = tmp_path / "table.csv"
    pl.DataFrame(rows).write_csv(table)
    from_table = rebar.json(*scoring(table, campaign / "decomposition.yaml"), "--per-run")
    # A table does not say who perceived, so there the observables about detections count for the agent.
    decomposition = load_decomposition("search-and-report")
    about_sensor = {name for name, node in decomposition.observables.items() if node.subject == "perception"}
    apart = {
        node for node in decomposition.nodes if about_sensor & {node, *decomposition.observables_under(node)}
    }
    assert without(from_table["nodes"], apart) == without(direct["nodes"], apart) != []
    for table_run, direct_run in zip(from_table["runs"], direct["runs"], strict=True):
        assert without(table_run["nodes"], apart) == without(direct_run["nodes"], apart) != []


def files_of(folder: Path) -> dict[str, str]:
    """Digests of everything that scoring writes."""
    names = ("scores.parquet", "report.html", "manifest.json", "evidence.jsonl")
    return {
        str(path.relative_to(folder)): digest_of(path)
        for path in folder.rglob("*")
        if path.name in (*names, "result.json")
    }


def test_scores_are_the_same_for_any_number_of_workers(campaign: Path, tmp_path: Path, rebar: Rebar) -> None:
    """Two recordings measured in this process, and by two others, with another decomposition than the campaign's."""
    folders = {count: tmp_path / str(count) / "out" for count in (1, 2)}
    for count, folder in folders.items():
        shutil.copytree(campaign, folder)
        rebar("score", folder, "--decomposition", "find-the-missing", "--workers", count)
    before, (alone, together) = files_of(campaign), map(files_of, folders.values())
    assert sum(name.endswith("result.json") for name in alone) == 2
    # The report and the manifest that lists it hold nothing of the number either.
    assert alone == together
    assert [name for name in before if before[name] == alone[name]] == []


def test_an_interrupted_score_leaves_the_folder_as_it_was(campaign: Path, tmp_path: Path) -> None:
    """Interrupted at the first measured recording and at the last; then scored to the end."""
    folder = tmp_path / "out"
    shutil.copytree(campaign, folder)
    before = files_of(folder)
    for last in (1, 2):

        def interrupt(finished: int, total: int, last: int = last) -> None:
            assert total == 2
            if finished == last:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            rescore_campaign(folder, "find-the-missing", on_measured=interrupt)
        assert files_of(folder) == before
    assert run(["verify", str(folder)]) == 0
    rescore_campaign(folder, "find-the-missing")
    assert files_of(folder).keys() == before.keys()
    assert files_of(folder) != before


def test_difficulty_tells_what_one_change_would_do(tmp_path: Path, rebar: Rebar) -> None:
    """The tension that is told for clear air and for more time is that of a file with them."""
    base = yaml.safe_load(SITUATION.read_text())
    base["environment"]["fog_level"], base["mission"]["time_limit_s"] = 9.0, 200.0

    line = ["difficulty", str(tmp_path / "situation.yaml"), "--decomposition", "search-and-report-full"]

    def tensions(**changes: object) -> dict[str, int]:
        (tmp_path / "situation.yaml").write_text(yaml.safe_dump(base | changes))
        measured = rebar.json(*line)["measured"]
        return {row["node"]: max(1, math.ceil(row["difficulty"] / 20.0)) for row in measured}

    clear = tensions(environment=base["environment"] | {"fog_level": 0.0, "rain_level": 0.0})
    longer = tensions(mission=base["mission"] | {"time_limit_s": 300.0})
    here = tensions()
    told = re.findall(
        r"(KA-\d\d): tension (\d), measured \d+\.(.*?)(?=KA-\d\d: tension|$)", rebar.words(*line)
    )
    assert len(told) == 5
    for node, tension, words in told:
        assert int(tension) == here[node]
        for change, changed in (("in clear air", clear), ("with half as much time again", longer)):
            found = re.search(rf"(\d) {change}", words)
            assert (int(found[1]) if found else here[node]) == changed[node]
    assert any(longer[node] != here[node] for node, *_ in told)


def test_difficulty_shows_both_numbers_and_sentences(tmp_path: Path, rebar: Rebar) -> None:
    """The measured difficulty beside the published rating; what a sentence adds up is the number."""
    line = ["difficulty", SITUATION, "--decomposition", "search-and-report-full"]
    document = rebar.json(*line)
    # Nobody is escorted, and no order is given: what is not exercised is not measured.
    exercised = {row["node"] for row in document["nodes"] if row["difficulty"] is not None}
    measured = {row["node"]: row for row in document["measured"]}
    assert {"KA-03", "KA-18", "KA-20"} <= measured.keys() <= exercised
    for row in measured.values():
        parts = row["average"] + sum(part["points"] for part in row["contributions"])
        assert row["difficulty"] == pytest.approx(min(100.0, max(0.0, parts)))
    shown = rebar.words(*line)
    assert "Node Published Tension Measured Ruled by" in shown
    sentence = r"KA-\d\d: tension \d, measured \d+\. The panel fails it in \d+% of such runs"
    assert len(re.findall(sentence, shown)) == 5
    shown = rebar.words(*line, "--node", "KA-20")
    number = measured["KA-20"]["difficulty"]
    assert f"KA-20: tension {max(1, math.ceil(number / 20.0))}, measured {number:.0f}. The panel" in shown
    assert "of the 360 s allowed" in shown
    none = "No measured difficulty: "
    assert f"{none}there is no scale for this decomposition" in rebar.words("difficulty", SITUATION)
    crowded = tmp_path / "crowded.yaml"
    crowded.write_text(SITUATION.read_text().replace("separation_m: 2.0", "separation_m: 700.0"))
    assert f"{none}the actors find no room" in rebar.words("difficulty", crowded, *line[2:])
    rebar.refused(*line, "--scale", tmp_path / "none.yaml")

"""`rebar score` as a user meets it: tables from other sources, one document for every source, and explained scores."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import EXAMPLE, fly_short, json_of

from bench.campaign import digest_of, rescore_campaign
from bench.cli._app import run
from bench.documents import load_document
from bench.scoring import Explanation, ScoreReport
from decompositions import load_decomposition

DOCS_SCORING = Path(__file__).parents[2] / "docs" / "scoring.md"
WORKED = EXAMPLE.parent / "worked"


@pytest.fixture
def worked(tmp_path: Path) -> list[str]:
    """The command line for the paper's two runs."""
    shutil.copy(WORKED / "observations.csv", tmp_path / "table.csv")
    shutil.copy(WORKED / "decomposition.yaml", tmp_path / "worked.yaml")
    return [
        "score",
        "--observations",
        str(tmp_path / "table.csv"),
        "--decomposition",
        str(tmp_path / "worked.yaml"),
    ]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of two sessions that run out of time after ten simulated seconds."""
    return fly_short(tmp_path_factory.mktemp("short"))


def test_the_worked_tables_to_the_digit(worked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run 1: 30 (2/2), 50, 30 (3/3); run 2: 80 (1/2), 50, 50 (2/3); over both: 40 and 83.3 %."""
    report = json_of([*worked, "--json", "--per-run"], capsys)
    ScoreReport.model_validate(report)
    runs = {
        run["run"]: {
            node["id"]: (node["score"], node["achieved"], node["considered"]) for node in run["nodes"]
        }
        for run in report["runs"]
    }
    assert runs["1"] == {
        "OBS1": (30, 1, 1),
        "OBS2": (80, 1, 1),
        "VAB1": (30, 2, 2),
        "OBS3": (50, 1, 1),
        "VAB2": (50, 1, 1),
        "KA1": (30, 3, 3),
    }
    assert runs["2"] == {
        "OBS1": (None, 0, 1),
        "OBS2": (80, 1, 1),
        "VAB1": (80, 1, 2),
        "OBS3": (50, 1, 1),
        "VAB2": (50, 1, 1),
        "KA1": (50, 2, 3),
    }
    whole = {row["id"]: row for row in report["nodes"] if row["configuration"] == "all"}
    assert (whole["KA1"]["score"], whole["KA1"]["confidence"]) == (40.0, pytest.approx(5 / 6, abs=1e-15))
    assert (whole["VAB1"]["score"], whole["VAB1"]["confidence"]) == (55.0, 0.75)
    assert (whole["OBS1"]["scored"], whole["OBS1"]["considered"], whole["OBS1"]["passed"]) == (1, 2, 1)
    assert (whole["KA1"]["passed"], whole["KA1"]["considered"], whole["KA1"]["runs"]) == (1, 2, 2)
    assert (whole["KA1"]["passed_low"], whole["KA1"]["passed_high"]) == pytest.approx(
        (0.01258, 0.98742), abs=5e-6
    )
    assert whole["KA1"]["raised_by_failure"] is True
    assert (whole["KA1"]["score_low"], whole["KA1"]["score_high"]) == (
        None,
        None,
    )  # no design point was flown twice
    assert report["absent"] == 0

    assert run(worked) == 0
    shown = capsys.readouterr().out
    assert "40.0" in shown
    assert "83" in shown
    assert "1 of 2" in shown


def test_the_command_of_the_page_prints_the_papers_result(capsys: pytest.CaptureFixture[str]) -> None:
    """The command as docs/scoring.md has it prints score and confidence of KA1: 40 and 83.3 %."""
    line = re.search(
        r"^rebar (score --observations examples/worked/.*)$", DOCS_SCORING.read_text(), re.MULTILINE
    )
    assert line
    words = [str(EXAMPLE.parents[1] / word) if "/" in word else word for word in line[1].split()]
    assert run(words) == 0
    (row,) = (text for text in capsys.readouterr().out.splitlines() if text.lstrip().startswith("KA1"))
    assert re.search(r"\b40(\.0)?\b", row)
    assert "83.3" in row


def test_the_short_decomposition_of_the_page_scores_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The whole example of docs/scoring.md, which names no measure; to fly, it lacks three things of each observable."""
    example = re.search(r"```yaml\n(format: .*?)```", DOCS_SCORING.read_text(), re.DOTALL)
    assert example
    path, table = tmp_path / "parcels.yaml", tmp_path / "runs.csv"
    path.write_text(example[1])
    table.write_text("run,observable,difficulty,x\n1,O-1,30,0.95\n1,O-2,50,1\n2,O-1,30,0.9\n2,O-2,50,0.5\n")
    line = ["score", "--observations", str(table), "--decomposition", str(path), "--json"]
    nodes = {row["id"]: row for row in json_of(line, capsys)["nodes"] if row["configuration"] == "all"}
    assert [(nodes[name]["passed"], nodes[name]["considered"]) for name in ("KA-1", "O-1", "O-2")] == [
        (1, 2),
        (2, 2),
        (1, 2),
    ]
    assert run(["decomposition", "check", str(path)]) == 2
    messages = capsys.readouterr().err
    assert [
        messages.count(words) for words in ("names no measure", "does not say why", "no key factors")
    ] == [2, 2, 2]


def test_runs_are_listed_only_on_request(worked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Without --per-run the document has none; absent rows are counted, and their difficulty is null."""
    table = Path(worked[2])
    table.write_text("run,observable,difficulty,x,considered\n007,OBS1,30,1,\n7,OBS3,50,,no\n")
    assert json_of([*worked, "--json"], capsys)["runs"] is None
    report = json_of([*worked, "--json", "--per-run"], capsys)
    assert ([run["run"] for run in report["runs"]], report["absent"]) == (["007", "7"], 4)
    nodes = {node["id"]: node for node in report["runs"][0]["nodes"]}
    assert (nodes["VAB2"]["difficulty"], nodes["VAB2"]["score"], nodes["VAB2"]["confidence"]) == (
        None,
        None,
        None,
    )
    assert run([*worked, "--per-run"]) == 0
    shown = capsys.readouterr().out
    assert "4 pairs of run and observable have no row" in shown
    assert "not scored" in shown


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["score"], "nothing to score"),
        (["score", "--observations", "t.csv"], "give --decomposition FILE"),
        (
            ["score", "out", "--observations", "t.csv", "--decomposition", "d.yaml"],
            "cannot be given together with folders",
        ),
        (
            ["score", "--observations", "nowhere.csv", "--decomposition", "paper-tables"],
            "there is no such file",
        ),
    ],
)
def test_what_is_missing_is_said(line: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and a sentence."""
    assert run(line) == 2
    assert words in capsys.readouterr().err


def test_the_faults_of_a_table_come_all_at_once_with_lines(
    worked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Each on a line of its own, ready for an editor to jump to."""
    table = Path(worked[2])
    table.write_text("run,observable,difficulty,x\n1,OBS1,30,2\n1,OBS8,30,1\n1,OBS1,300,1\n")
    assert run(worked) == 2
    messages = capsys.readouterr().err.splitlines()
    assert [line.split(" ")[1] for line in messages] == [f"{table}:{number}:" for number in (2, 3, 4, 4)]


def test_a_mean_is_explained_down_to_the_rows(worked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Failures first; the child that ruled, x against its threshold, and the line of the table."""
    explanation = Explanation.model_validate(json_of([*worked, "--explain", "KA1", "--json"], capsys))
    (agent,) = explanation.agents
    assert (agent.summary.score, agent.scored_runs) == (40.0, ("1", "2"))
    failed, passed = agent.runs
    assert (failed.run, failed.state, failed.score, failed.ruled_by) == (
        "2",
        "failed",
        50.0,
        ("KA1", "VAB2", "OBS3"),
    )
    assert [(leaf.id, leaf.state, leaf.ruling) for leaf in failed.observables] == [
        ("OBS1", "failed", False),
        ("OBS3", "achieved", True),
        ("OBS2", "achieved", False),
    ]
    assert (failed.observables[0].x, failed.observables[0].threshold, failed.observables[0].score) == (
        0.0,
        0.5,
        None,
    )
    assert failed.observables[0].row == f"{worked[2]}:5"
    assert (passed.run, passed.ruled_by) == ("1", ("KA1", "VAB1", "OBS1"))

    assert run([*worked, "--explain", "KA1", "--limit", "1"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
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


def test_a_principle_has_its_verdict_everywhere(
    worked: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By its essential key attribute alone: in text, in JSON, and explained with the reason of the document."""
    principles = (
        'principles:\n  - {id: careful, title: Careful, asks: "?", children: [KA1, KA2], essential: [KA2], '
        'essential_reason: The rest is a means.}\nkey_attributes:\n  - {id: KA2, title: Two, asks: "?", children: [VAB2]}'
    )
    document = tmp_path / "worked.yaml"
    document.write_text(document.read_text().replace("key_attributes:", principles))
    assert run(worked) == 0
    assert "careful: passed 2 of 2 runs (16 to 100 %)" in capsys.readouterr().out
    report = json_of([*worked, "--json"], capsys)
    verdicts = {node["id"]: (node["verdict_passed"], node["verdict_considered"]) for node in report["nodes"]}
    assert (verdicts["careful"], verdicts["KA1"]) == ((2, 2), (None, None))
    assert run([*worked, "--explain", "careful"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
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


def test_a_decomposition_may_begin_anywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Observables alone are a decomposition; what is shown is the top of what there is."""
    leaf = (WORKED / "decomposition.yaml").read_text().splitlines()[-1]
    (tmp_path / "flat.yaml").write_text(
        f"format: rebar.decomposition/1\nname: flat\ntitle: Flat\nobservables:\n{leaf}\n", encoding="utf-8"
    )
    (tmp_path / "t.csv").write_text("run,observable,difficulty,x\na,OBS3,30,1\n")
    line = [
        "score",
        "--observations",
        str(tmp_path / "t.csv"),
        "--decomposition",
        str(tmp_path / "flat.yaml"),
    ]
    assert run(line) == 0
    shown = capsys.readouterr().out
    assert "OBS3" in shown
    assert "30.0" in shown


def test_an_unknown_node_is_answered_with_those_near_it(
    worked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """A mistyped node is answered with a sentence."""
    assert run([*worked, "--explain", "KA2"]) == 2
    assert "did you mean KA1" in capsys.readouterr().err


def test_one_document_for_a_campaign_and_its_runs(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A campaign's per-run nodes are those of its runs by themselves, scored again from their recordings."""
    whole = ScoreReport.model_validate(json_of(["score", str(campaign), "--json", "--per-run"], capsys))
    assert (whole.kind, whole.absent, len(whole.runs or ())) == ("campaign", 0, 2)
    assert {row.configuration for row in whole.nodes} > {"all"}
    assert all(row.competence_50 is None for row in whole.nodes if row.configuration != "all")
    for scored_run in whole.runs or ():
        assert scored_run.recording
        alone = ScoreReport.model_validate(
            json_of(["score", str(Path(scored_run.recording).parent), "--json"], capsys)
        )
        assert alone.kind == "run"
        assert alone.runs is not None
        assert [node.model_dump() for node in alone.runs[0].nodes] == [
            node.model_dump() for node in scored_run.nodes
        ]


def test_explaining_a_campaign_leads_to_recordings_and_changes_nothing(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the mean to factor, moment and recording; every file stays as it was."""
    before = {
        path: path.stat().st_mtime_ns
        for path in campaign.rglob("*")
        if path.is_file() and "journal" not in path.name
    }
    explanation = Explanation.model_validate(
        json_of(["score", str(campaign), "--explain", "KA-20", "--json"], capsys)
    )
    assert {path: path.stat().st_mtime_ns for path in before} == before
    (agent,) = explanation.agents
    assert {run.state for run in agent.runs} == {"failed"}
    for explained in agent.runs:
        assert explained.recording
        assert Path(explained.recording).is_file()
        failed = [leaf for leaf in explained.observables if leaf.state == "failed"]
        assert failed
        assert all(leaf.evidence and any(row.ruling for row in leaf.factors) for leaf in failed)
    repeated = json_of(
        ["score", str(campaign), "--decomposition", "search-and-report", "--explain", "KA-20", "--json"],
        capsys,
    )
    assert Explanation.model_validate(repeated) == explanation
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert run(["score", str(campaign), "--explain", "KA-20"]) == 0
    assert "recording.mcap" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["score-report", "score-explanation", "assurance-case"])
def test_the_documents_have_schemas(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every field of what --json prints has its sentence or its type."""
    schema = json_of(["schema", name], capsys)
    assert schema["additionalProperties"] is False


def test_a_printed_document_is_read_back(
    worked: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was kept on disk is a document like any other."""
    file = tmp_path / "kept.json"
    file.write_text(json.dumps(json_of([*worked, "--json"], capsys)))
    assert load_document(file, ScoreReport).decomposition == "worked"


def test_difficulty_says_what_rules(capsys: pytest.CaptureFixture[str]) -> None:
    """The factor that rules, what follows, and the field of the SimSpec."""
    document = json_of(["difficulty", str(EXAMPLE), "--node", "KA-18", "--json"], capsys)
    assert [node["node"] for node in document["nodes"]] == ["KA-18"]
    assert document["factors"]["bystander_density_per_km2"]["paths"] == ["actors[civilians].density_per_km2"]
    assert run(["difficulty", str(EXAMPLE), "--node", "KA-18"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "ruled by bystander_density_per_km2, in" in shown
    assert "next is bystander_proximity_m, " in shown
    assert "bystander_density_per_km2 = 390.1 1/km2 rates" in shown
    assert "(actors[civilians].density_per_km2)" in shown
    assert run(["difficulty", str(EXAMPLE)]) == 0
    assert "bystander_density_per_km2; next bystander_proximity_m +" in " ".join(
        capsys.readouterr().out.split()
    )
    assert run(["difficulty", str(EXAMPLE), "--node", "KA-81"]) == 2
    assert "did you mean KA-18" in capsys.readouterr().err


def without(nodes: list[dict[str, Any]], ids: set[str]) -> list[dict[str, Any]]:
    return [node for node in nodes if node["id"] not in ids]


def test_a_campaign_written_as_a_table_scores_the_same(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the bench measured, carried elsewhere and back, has the same numbers to the last bit."""
    direct = json_of(["score", str(campaign), "--json", "--per-run"], capsys)
    rows = [
        {
            "run": run["run"],
            "observable": node["id"],
            "difficulty": node["difficulty"],
            "x": node["x"],
            "considered": node["considered"] == 1,
            "design_point": run["design_point"],
            "agent": run["agent"],
        }
        for run in direct["runs"]
        for node in run["nodes"]
        if node["level"] == "observable"
    ]
    table = tmp_path / "table.csv"
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    line = ["score", "--observations", str(table), "--decomposition", str(campaign / "decomposition.yaml")]
    from_table = json_of([*line, "--json", "--per-run"], capsys)
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


def test_scores_are_the_same_for_any_number_of_workers(campaign: Path, tmp_path: Path) -> None:
    """Two recordings measured in this process, and by two others, with another decomposition than the campaign's."""
    folders = {count: tmp_path / str(count) / "out" for count in (1, 2)}
    for count, folder in folders.items():
        shutil.copytree(campaign, folder)
        line = ["score", str(folder), "--decomposition", "find-the-missing", "--workers", str(count)]
        assert run(line) == 0
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


def test_difficulty_tells_what_one_change_would_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tension that is told for clear air and for more time is that of a file with them."""
    base = yaml.safe_load((Path(__file__).parents[2] / "campaigns" / "panel" / "situation.yaml").read_text())
    base["environment"]["fog_level"], base["mission"]["time_limit_s"] = 9.0, 200.0

    def tensions(**changes: object) -> dict[str, int]:
        path = tmp_path / "situation.yaml"
        path.write_text(yaml.safe_dump(base | changes))
        line = ["difficulty", str(path), "--decomposition", "search-and-report-full"]
        document = json_of([*line, "--json"], capsys)
        assert run(line) == 0
        return {row["node"]: max(1, math.ceil(row["difficulty"] / 20.0)) for row in document["measured"]}

    clear = tensions(environment=base["environment"] | {"fog_level": 0.0, "rain_level": 0.0})
    longer = tensions(mission=base["mission"] | {"time_limit_s": 300.0})
    capsys.readouterr()
    here = tensions()
    text = " ".join(capsys.readouterr().out.split())
    told = re.findall(r"(KA-\d\d): tension (\d), measured \d+\.(.*?)(?=KA-\d\d: tension|$)", text)
    assert len(told) == 5
    for node, tension, words in told:
        assert int(tension) == here[node]
        for change, changed in (("in clear air", clear), ("with half as much time again", longer)):
            found = re.search(rf"(\d) {change}", words)
            assert (int(found[1]) if found else here[node]) == changed[node]
    assert any(longer[node] != here[node] for node, *_ in told)


def test_difficulty_shows_both_numbers_and_sentences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The measured difficulty beside the published rating; what a sentence adds up is the number."""
    situation = str(Path(__file__).parents[2] / "campaigns" / "panel" / "situation.yaml")
    line = ["difficulty", situation, "--decomposition", "search-and-report-full"]
    document = json_of([*line, "--json"], capsys)
    # Nobody is escorted, and no order is given: what is not exercised is not measured.
    exercised = {row["node"] for row in document["nodes"] if row["difficulty"] is not None}
    measured = {row["node"]: row for row in document["measured"]}
    assert {"KA-03", "KA-18", "KA-20"} <= measured.keys() <= exercised
    for row in measured.values():
        parts = row["average"] + sum(part["points"] for part in row["contributions"])
        assert row["difficulty"] == pytest.approx(min(100.0, max(0.0, parts)))
    assert json_of([*line, "--json"], capsys) == document
    assert run(line) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "Node Published Tension Measured Ruled by" in shown
    assert (
        len(re.findall(r"KA-\d\d: tension \d, measured \d+\. The panel fails it in \d+% of such runs", shown))
        == 5
    )
    assert run([*line, "--node", "KA-20"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    tension = max(1, math.ceil(measured["KA-20"]["difficulty"] / 20.0))
    number = measured["KA-20"]["difficulty"]
    assert f"KA-20: tension {tension}, measured {number:.0f}. The panel fails it" in shown
    assert "of the 360 s allowed" in shown
    assert run(["difficulty", situation]) == 0
    assert "No measured difficulty: there is no scale for this decomposition" in " ".join(
        capsys.readouterr().out.split()
    )
    crowded, text = tmp_path / "crowded.yaml", Path(situation).read_text()
    crowded.write_text(text.replace("separation_m: 2.0", "separation_m: 700.0"))
    assert run(["difficulty", str(crowded), *line[2:]]) == 0
    assert "No measured difficulty: the actors find no room" in " ".join(capsys.readouterr().out.split())
    assert run([*line, "--scale", str(tmp_path / "none.yaml")]) == 2

"""What was written is on the disk when its writer is killed right behind the call."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from made_run import simspec

from bench.campaign import RealizationState, open_journal
from bench.recording import read_metadata, read_records, read_simspec
from bench.recording._recorder import CHUNK_BYTES

TESTS = Path(__file__).parent


def killed(body: str, folder: Path) -> None:
    """A program that ends by SIGKILL: no buffer is written at its end."""
    program = f"""
import os, signal, sys
from contextlib import ExitStack
from pathlib import Path
sys.path[:0] = [{str(TESTS)!r}, {str(TESTS / "campaign")!r}]
folder = Path(sys.argv[1])
stack = ExitStack()
{body}
os.kill(os.getpid(), signal.SIGKILL)
"""
    command = [sys.executable, "-c", program, str(folder)]
    ran = subprocess.run(command, capture_output=True, check=False)
    assert ran.returncode == -signal.SIGKILL, ran.stderr.decode()


@pytest.mark.parametrize(
    "text", ["'a' * {0}", "random.Random(number).randbytes({0} // 2).hex()"], ids=["even", "random"]
)
@pytest.mark.parametrize("text_bytes", [1000, 20_000])
def test_a_killed_recording_has_lost_the_open_chunk_alone(tmp_path: Path, text: str, text_bytes: int) -> None:
    """However small a chunk becomes by compression: several would fit into the buffer of the file."""
    count = 4 * CHUNK_BYTES // text_bytes
    killed(
        f"""
import random
from made_run import simspec, text_record
from bench.recording import open_recording
recorder = stack.enter_context(open_recording(folder / "r.mcap", simspec=simspec(), versions={{}}))
for number in range({count}):
    recorder(text_record(number * 0.01, "/words", {text.format(text_bytes)}))
""",
        tmp_path,
    )
    kept = list(read_records(tmp_path / "r.mcap"))
    assert count - len(kept) <= CHUNK_BYTES / text_bytes + 1
    assert [record.time.ns for record in kept] == [number * 10_000_000 for number in range(len(kept))]


def test_a_recording_that_has_just_begun_says_what_it_is(tmp_path: Path) -> None:
    killed(
        """
from made_run import simspec
from bench.recording import open_recording
stack.enter_context(open_recording(folder / "r.mcap", simspec=simspec(), versions={"a": "1"}, metadata={"b": "2"}))
""",
        tmp_path,
    )
    assert read_simspec(tmp_path / "r.mcap").name == simspec().name
    assert read_metadata(tmp_path / "r.mcap") == {"rebar.versions": {"a": "1"}, "rebar.session": {"b": "2"}}


JOURNAL = """
from campaign_fakes import small_campaign
from bench.campaign import open_journal, realizations
from bench.campaign.storage._journal import PlannedRealization
from bench.contracts import Outcome, SessionResult
plans = realizations(small_campaign(points=1, replicates=2))
journal = stack.enter_context(open_journal(folder / "journal.sqlite"))
journal.add(PlannedRealization(plan, "0" * 64, "1" * 64) for plan in plans)
"""
START = "journal.start(plans[0].id, 'w1')"
FINISH = "journal.finish(SessionResult(realization=plans[0].id, outcome=Outcome.COMPLETED), 'a' * 64)"


@pytest.mark.parametrize(
    ("steps", "state", "attempts", "results"),
    [("", "planned", 0, 0), (START, "running", 1, 0), (f"{START}\n{FINISH}", "done", 1, 1)],
)
def test_a_killed_runner_has_journalled_its_last_step(
    tmp_path: Path, steps: str, state: str, attempts: int, results: int
) -> None:
    """In the journal, and a result in the chain of evidence beside it."""
    killed(JOURNAL + steps, tmp_path)
    chain = tmp_path / "evidence.jsonl"
    lines = chain.read_text().splitlines() if chain.exists() else []
    assert sum(json.loads(line)["kind"] == "flown" for line in lines) == results
    with open_journal(tmp_path / "journal.sqlite") as journal:
        first, second = journal.entries()
    assert (first.state, first.attempts) == (RealizationState(state), attempts)
    assert (second.state, second.attempts) == (RealizationState.PLANNED, 0)


def test_a_line_of_an_event_and_a_whole_file_are_there(tmp_path: Path) -> None:
    killed(
        """
from bench.campaign import CampaignPlanned
from bench.campaign.storage._files import write_whole
from bench.cli._event_lines import open_event_lines
write_whole(folder / "result.json", "{}" * 9)
with open_event_lines(folder / "events.jsonl", "c") as observe:
    observe(CampaignPlanned(3, 1))
    os.kill(os.getpid(), signal.SIGKILL)
""",
        tmp_path,
    )
    assert (tmp_path / "result.json").read_text() == "{}" * 9
    assert json.loads((tmp_path / "events.jsonl").read_text())["total"] == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["events.jsonl", "result.json"]

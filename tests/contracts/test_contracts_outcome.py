"""Every outcome has somebody to blame, and stands in the one table of the docs with it."""

from __future__ import annotations

import re
from pathlib import Path

from bench.contracts import Outcome
from bench.reporting.text._outcomes import OUTCOME_MEANINGS

PAGE = Path(__file__).parents[2] / "docs" / "running-campaigns.md"
ROW = re.compile(r"^\| `(\w+)` \| (\w+) \| (yes|no) \| .+ \|$", re.MULTILINE)


def rows() -> list[tuple[str, str, str]]:
    """Name, whose doing it is, and whether it counts."""
    text = PAGE.read_text("utf-8")
    return ROW.findall(text[text.index("## Outcomes") : text.index("## Retries and their pauses")])


def test_the_table_of_the_docs_is_the_code() -> None:
    stated = [(outcome.value, "yes" if outcome.counts else "no") for outcome in Outcome]
    assert [(name, counts) for name, _, counts in rows()] == stated
    assert {blame for _, blame, _ in rows()} == {"agent", "host", "bench", "situation", "nobody"}


def test_what_an_agent_does_counts_and_nothing_else_is_laid_on_it() -> None:
    """An outcome that is the agent's doing counts; of the others only a mission that was completed does."""
    assert {outcome for outcome in Outcome if outcome.counts} == {
        Outcome(name) for name, blame, _ in rows() if blame == "agent" or name == "completed"
    }


def test_every_outcome_has_a_meaning_in_the_report() -> None:
    assert set(OUTCOME_MEANINGS) == set(Outcome)
    assert len(set(OUTCOME_MEANINGS.values())) == len(Outcome)

"""Every outcome has somebody to blame, and stands in the one table of the docs with it."""

from __future__ import annotations

import re
from pathlib import Path

from bench.contracts import Blame, Outcome
from bench.reporting.text._outcomes import OUTCOME_MEANINGS

PAGE = Path(__file__).parents[2] / "docs" / "running-campaigns.md"
ROW = re.compile(r"^\| `(\w+)` \| (\w+) \| (yes|no) \| .+ \|$", re.MULTILINE)


def test_the_table_of_the_docs_is_the_code() -> None:
    """In the order of the code: each name, whose doing it is, and whether it counts."""
    text = PAGE.read_text("utf-8")
    table = text[text.index("## Outcomes") : text.index("## Retries and their pauses")]
    assert ROW.findall(table) == [
        (outcome.value, outcome.blame.value, "yes" if outcome.counts else "no") for outcome in Outcome
    ]


def test_what_an_agent_does_counts_and_nothing_else_is_laid_on_it() -> None:
    """An outcome that is the agent's doing counts; of the others only a mission that was completed does."""
    assert {outcome for outcome in Outcome if outcome.counts} == {
        outcome for outcome in Outcome if outcome.blame is Blame.AGENT or outcome is Outcome.COMPLETED
    }


def test_every_outcome_has_a_meaning_in_the_report() -> None:
    assert set(OUTCOME_MEANINGS) == set(Outcome)
    assert len(set(OUTCOME_MEANINGS.values())) == len(Outcome)

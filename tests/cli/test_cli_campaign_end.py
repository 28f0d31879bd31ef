"""What the end of a campaign needs is loaded while the last sessions fly."""

from __future__ import annotations

import pytest

from bench.campaign import CampaignPlanned, RealizationFinished, RealizationStarted
from bench.cli._campaign_end import CampaignEnd
from bench.contracts import Outcome


def started(name: str) -> RealizationStarted:
    return RealizationStarted(name, "w1", 1)


def finished(done: int, total: int) -> RealizationFinished:
    return RealizationFinished(f"run {done}", Outcome.COMPLETED, "", 1.0, done, total)


@pytest.mark.parametrize(
    ("cores", "done", "loads"),
    [(2, 0, [3]), (3, 0, [2, 3]), (1, 0, []), (8, 0, [0, 1, 2, 3]), (2, 3, [0]), (2, 4, [])],
)
def test_loading_begins_when_a_core_is_free(cores: int, done: int, loads: list[int]) -> None:
    """With 4 sessions, `done` of them earlier: after which of its sessions the campaign has loaded."""
    loaded_after: list[int] = []
    number = 0
    end = CampaignEnd(cores, lambda: loaded_after.append(number))
    end.observe(CampaignPlanned(4, done))
    assert not loaded_after
    if done < 4:
        end.observe(started("first"))
    for number in range(1, 4 - done + 1):
        end.observe(finished(done + number, 4))

    assert loaded_after == loads

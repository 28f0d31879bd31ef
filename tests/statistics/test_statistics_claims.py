"""Plain sentences for counts: never more than the exact bound allows."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from bench.statistics import claim
from bench.statistics._claims import further_passes_for_claim, pass_rate_at_least


def test_what_fourteen_passes_say() -> None:
    """The bound, the straight passes that 95 % takes, and how many are left."""
    assert claim(14, 14) == (
        "14 of 14 runs passed: with 95 % confidence at least 80.7 % of such runs would (one-sided, exact); "
        "59 straight passes are needed to claim 95 %: 45 more."
    )


def test_with_failures_with_none_and_with_nothing() -> None:
    """Failures raise the price, no pass has an upper bound only, nothing tried claims nothing."""
    assert claim(12, 14).endswith("110 more straight passes are needed to claim 95 %.")
    assert (
        claim(0, 14)
        == "0 of 14 runs passed: with 95 % confidence at most 19.3 % of such runs would (one-sided, exact)."
    )
    assert claim(0, 0).startswith("Nothing was tried")
    assert claim(59, 59).endswith("which is enough to claim 95 %.")
    assert "1 more straight pass is needed" in claim(91, 92)
    assert claim(5, 5, share=0.5, level=0.9).startswith(
        "5 of 5 runs passed: with 90 % confidence at least 63.0 %"
    )


def test_fifty_nine_straight_passes() -> None:
    """0.95^59 < 0.05 <= 0.95^58, and the same rule elsewhere."""
    assert 0.95**59 < 0.05 <= 0.95**58
    assert [further_passes_for_claim(0, 0, share) for share in (0.5, 0.9, 0.95, 0.99)] == [5, 29, 59, 299]


@settings(deadline=None)
@given(st.integers(0, 60), st.integers(0, 20), st.sampled_from([0.5, 0.8, 0.9, 0.95]))
def test_more_passes_are_just_enough(passed: int, failed: int, share: float) -> None:
    """After so many more the binomial tail is at most 5 %, and one fewer would not do; the bound then claims
    the share.
    """
    more = further_passes_for_claim(passed, passed + failed, share)
    assert passed + more > 0
    assert binom.sf(passed + more - 1, passed + failed + more, share) <= 0.05
    assert pass_rate_at_least(passed + more, passed + failed + more) >= share - 1e-9
    if more:
        assert binom.sf(passed + more - 2, passed + failed + more - 1, share) > 0.05


@settings(deadline=None)
@given(st.integers(1, 200), st.integers(0, 200))
def test_the_sentence_never_says_more_than_the_bound(passed: int, failed: int) -> None:
    """The printed share is rounded down."""
    printed = re.search(r"at least ([\d.]+) %", claim(passed, passed + failed))
    assert printed is not None
    assert float(printed[1]) / 100 <= pass_rate_at_least(passed, passed + failed) + 1e-9


@settings(deadline=None)
@given(st.integers(0, 100), st.integers(0, 100))
def test_a_failure_never_helps(passed: int, failed: int) -> None:
    """One pass turned into a failure lowers the claim and raises the price."""
    if passed:
        assert pass_rate_at_least(passed - 1, passed + failed) < pass_rate_at_least(passed, passed + failed)
        assert further_passes_for_claim(passed - 1, passed + failed, 0.9) >= further_passes_for_claim(
            passed, passed + failed, 0.9
        )


def test_what_is_no_count() -> None:
    """More passes than trials, and a share that no number of passes claims."""
    with pytest.raises(ValueError, match="3 of 2"):
        claim(3, 2)
    with pytest.raises(ValueError, match="claim of 1"):
        further_passes_for_claim(1, 1, 1.0)

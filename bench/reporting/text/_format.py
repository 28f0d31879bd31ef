"""Numbers as text: the same format in the page and in the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .._campaign_data import Tally


def number(value: float | None, digits: int = 1) -> str:
    """A number with fixed digits, or an en dash where there is none."""
    if value is None:
        return "–"
    # `or 0.0` turns a negative zero into a positive one.
    rounded = round(value, digits) or 0.0
    return f"{rounded:.{digits}f}".replace("-", "−")


def percent(value: float | None) -> str:
    """A share as a percentage, or an en dash."""
    return "–" if value is None else f"{100 * value:.1f} %"


def score(value: float | None) -> str:
    """A score, or that there is none."""
    return "not scored" if value is None else number(value)


def interval(tally: Tally | None) -> str:
    """The confidence's interval as `low to high %`."""
    if tally is None or tally.confidence_low is None or tally.confidence_high is None:
        return "–"
    return f"{100 * tally.confidence_low:.0f} to {100 * tally.confidence_high:.0f} %"


def passed_runs(tally: Tally) -> str:
    """How many runs passed a node that was considered: `11 of 12 runs (62 to 100 %)`."""
    return f"{tally.passes.passed} of {plural(tally.passes.runs, 'run')} ({passed_interval(tally)})"


def verdict(tally: Tally) -> str:
    """The verdict of a principle, or how many runs passed another node: `passed 11 of 12 runs (62 to 100 %)`."""
    if not tally.passes.runs:
        return "no verdict, because no run considered anything essential"
    return f"passed {passed_runs(tally)}"


def passed_interval(tally: Tally) -> str:
    """The interval of the share of runs that pass."""
    return f"{100 * tally.passes.low:.0f} to {100 * tally.passes.high:.0f} %"


def span(low: float | None, high: float | None) -> str:
    """A range of difficulty, one number where both ends are the same."""
    if low is None or high is None:
        return "–"
    # Difficulties are compared to six decimals (docs/rulings.md 14).
    return number(low) if abs(high - low) < 5e-7 else f"{number(low)} to {number(high)}"


def difficulties(tallies: Iterable[Tally]) -> str:
    """The range of difficulty over several tallies."""
    rated = [tally for tally in tallies if tally.difficulty_low is not None]
    lows, highs = ([getattr(tally, f"difficulty_{end}") for tally in rated] for end in ("low", "high"))
    return span(min(lows, default=None), max(highs, default=None))


def p_value(value: float | None) -> str:
    """A p value with no more digits than it deserves."""
    if value is None:
        return "–"
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def plural(count: int, singular: str, plural_form: str = "") -> str:
    """`1 run`, `2 runs`."""
    return f"{count} {singular if count == 1 else plural_form or singular + 's'}"


def listed(values: Sequence[str]) -> str:
    """`a, b and c`."""
    return values[0] if len(values) == 1 else f"{', '.join(values[:-1])} and {values[-1]}" if values else ""

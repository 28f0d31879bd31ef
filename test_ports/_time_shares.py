"""Shares of time as findings: how much of a flight keeps to something, how much of it is covered by something said."""

from __future__ import annotations

import numpy as np

from bench.arrays import Bools, Floats
from bench.contracts import Evidence

from ._measure import Finding
from .ground_truth._flown_track import Flight


def kept(flight: Flight, good: Bools, of: Bools, value: Floats, unit: str) -> Finding:
    """Share of the time in `of` for which `good` holds, 0 without such time; `value` (n,) at its breaks is the evidence."""
    x = flight.share(good, of)
    if x is None:
        return Finding(0.0, (Evidence(time_s=float(flight.time_s[-1]) if len(flight.time_s) else 0.0, text="it never flew so"),))
    broken = of & ~good
    begins = np.flatnonzero(broken & ~np.concatenate([[False], broken[:-1]]))
    return Finding(x, tuple(Evidence(time_s=float(flight.time_s[at]), text=f"{value[at]:.1f} {unit}") for at in begins))


def fresh_share(flight: Flight, said_s: Floats, max_gap_s: float, what: str, of: Bools | None = None) -> Finding:
    """Share of the time in `of` (in the air, when left out) at which something was said no longer than `max_gap_s` before."""
    of = flight.airborne if of is None else of
    if not len(said_s):
        return Finding(0.0, (Evidence(time_s=0.0, text=f"the agent said no {what}"),))
    index = np.searchsorted(said_s, flight.time_s, side="right") - 1
    age_s = np.where(index >= 0, flight.time_s - said_s[np.maximum(index, 0)], np.inf)
    x = flight.share(age_s <= max_gap_s + 1e-9, of)
    stale = flight.time_s[of & (age_s > max_gap_s + 1e-9)]
    text = f"no {what} within {max_gap_s:g} s before"
    return Finding(x or 0.0, tuple(Evidence(time_s=float(time_s), text=text) for time_s in stale[:1]))

"""What measures of the overhead simulation have in common: one column for each observable, and sums over the
views of a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.arrays import Bools, Counts, Floats, Narrow
from bench.contracts import Option
from bench.simspec import ASSETS

from ..batch._batch import Batch
from ..batch._draws import normal
from ..flight._bystanders import frame_counts
from ..flight._outcome import FlownMissions
from ..flight._views import Views, right_label_chance

Options = Mapping[str, Option]
Column = tuple[Floats, Bools]
"""Value and consideration of one observable in every mission."""

ROLES = {"bystander": 0, "adversary": 1, "clutter": 2}
DEFAULT_CONFIDENCE, DEFAULT_HEIGHT_PX = 0.35, 12.0
_STREAM_SHARES = 5000
_ASSET = {name: index for index, name in enumerate(ASSETS)}


class SharedSums:
    """The views of a batch, and what several observables ask of them, each worked out once."""

    def __init__(self, batch: Batch, views: Views) -> None:
        self.views = views
        self.flight_path: object = None  # of the measures of where it went
        self._batch = batch
        self._counts: Floats | None = None
        self._rightly: dict[float, Narrow] = {}
        self._place = views.row * len(ROLES) + batch.role[views.row, views.actor]
        self._clear: dict[tuple[float, float], tuple[Floats, Floats, Floats]] = {}

    def counts(self) -> Floats:
        """(n, a) in how many frames each actor was had rightly."""
        if self._counts is None:
            self._counts = frame_counts(self._batch, self.views, self.rightly(0.0))
        return self._counts

    def rightly(self, least: float) -> Narrow:
        """Chance of each view that one frame of it holds the actor with its own class, no less sure than
        that.
        """
        if least not in self._rightly:
            self._rightly[least] = right_label_chance(self.views, least)
        return self._rightly[least]

    def clear(self, options: Options, role: str) -> tuple[Floats, Floats, Floats]:
        """(n,) frames with an actor of a role in clear view, those expected to hold it rightly, and their
        variance, one by one.
        """
        least_px, least = (
            number(options, "min_height_px", DEFAULT_HEIGHT_PX),
            number(options, "min_confidence", DEFAULT_CONFIDENCE),
        )
        if not set(options) & {"asset", "min_range_m", "max_range_m"}:
            if (least_px, least) not in self._clear:
                chosen = self.views.height_px >= least_px
                self._clear[least_px, least] = self.sums(chosen, least, self._place, len(ROLES))
            frames, right, spread = (_of_role(summed, role) for summed in self._clear[least_px, least])
            return frames, right, spread
        chosen = self.chosen(options, role)
        frames, right, spread = (summed[:, 0] for summed in self.sums(chosen, least, self.views.row, 1))
        return frames, right, spread

    def chosen(self, options: Options, role: str) -> Bools:
        """Which views are clear ones of the actors that options name."""
        views, batch = self.views, self._batch
        least_px = number(options, "min_height_px", DEFAULT_HEIGHT_PX)
        chosen: Bools = has_role(batch, role, options)[views.row, views.actor] & (views.height_px >= least_px)
        chosen &= views.range_m >= number(options, "min_range_m", 0.0)
        chosen &= views.range_m <= number(options, "max_range_m", 100_000.0)
        return chosen

    def sums(self, chosen: Bools, least: float, place: Counts, kinds: int) -> tuple[Floats, Floats, Floats]:
        """(n, kinds) of these views, by their row and kind: frames, expected right ones, variance."""
        frames = np.where(chosen, self.views.frames, 0.0)
        right = frames * self.rightly(least)
        spread = right * (1.0 - self.rightly(least))
        size = len(self._batch) * kinds
        summed = [
            np.bincount(place, weights, size).astype(np.float64).reshape(-1, kinds)
            for weights in (frames, right, spread)
        ]
        return summed[0], summed[1], summed[2]

    def normal_draws(self, stream: int, count: int = 1) -> Floats:
        """(n, count) standard normal numbers of shares."""
        return normal(self._batch.seeds, _STREAM_SHARES + stream, count)

    def correlated_frames(self) -> Floats:
        """(n,) frames that hang together, as one look."""
        return np.maximum(2.0 * self._batch.correlation_s * self._batch.rate_hz, 1.0)


Measure = Callable[[Batch, FlownMissions, SharedSums, Options], Column]


@dataclass(frozen=True, slots=True)
class ComputedMeasure:
    """How a measure is computed, and the options with which it can be: with others it is not considered."""

    measure: Measure
    options: Sequence[str] = ()


def number(options: Options, name: str, usual: float) -> float:
    """An option that is a number."""
    value = options.get(name, usual)
    assert not isinstance(value, str)
    return float(value)


def has_role(batch: Batch, role: str, options: Options) -> Bools:
    """(n, a) actors of a role, and of an asset where options name one."""
    # Nobody is sought in a batch: `unfit` refuses such situations.
    nobody = np.zeros(batch.role.shape, dtype=np.bool_)
    in_role = batch.role == ROLES[role] if role in ROLES else batch.role >= 0 if role == "any" else nobody
    asset = options.get("asset")
    return in_role & (batch.asset == _ASSET[str(asset)]) if asset else in_role


def any_of(which: Bools) -> Bools:
    """(n,) whether any of a row."""
    return np.asarray(which.any(axis=1))


def always(batch: Batch) -> Bools:
    """(n,) considered in every mission."""
    return np.ones(len(batch), dtype=np.bool_)


def share(right: Bools, among: Bools) -> Floats:
    """(n,) of those in a row, the share that is good; 0 where there is none."""
    shares: Floats = (right & among).sum(axis=1) / np.maximum(among.sum(axis=1), 1)
    return shares


def targets(batch: Batch) -> Bools:
    """(n, k) tasks that are about an adversary."""
    return (batch.task_radius_m > 0.0) & (batch.task_actor >= 0)


def exposed(batch: Batch, flown: FlownMissions, options: Options) -> Bools:
    """(n, k) targets with a bystander near them for long enough."""
    return targets(batch) & (flown.exposure_s >= number(options, "min_exposure_s", 10.0))


def _of_role(sums: Floats, role: str) -> Floats:
    """One role's column of sums over roles; all of them together for any."""
    if role in ROLES:
        return sums[:, ROLES[role]]
    return sums[:, 0] + sums[:, 1] + sums[:, 2] if role == "any" else np.zeros(len(sums))

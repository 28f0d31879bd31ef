"""Members chosen from pools of places: clear of each other, and at a mean distance when one is required."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools, Floats
from bench.simspec import Placement

from .._footprint import Footprints, joined, too_close

# Candidates that are compared with each other at once. Of 32, 64 and 128 this was the fastest, measured on the scenes of
# campaigns/paper.yaml and on jammed groups.
_AT_ONCE = 64


class ChosenMembers:
    """The members chosen so far, each with clearance and spread from the others, and none too far from them."""

    def __init__(self, room: Footprints, spread_m: float, extent_m: float) -> None:
        self._room, self._spread_m, self._extent_m = room, spread_m, extent_m
        self.count = 0

    @classmethod
    def of(cls, size: int, placement: Placement) -> ChosenMembers:
        """Room for as many members, with the spread and the extent that the placement asks for."""
        return cls(
            Footprints(np.zeros((size, 2)), np.zeros(size), np.zeros((size, 2)), np.zeros(size)),
            placement.spread_m or 0.0,
            placement.extent_m or np.inf,
        )

    def members(self) -> Footprints:
        return self._room[np.arange(self.count)]

    def fits(self, candidate: Footprints, but: int | None = None) -> bool:
        """Whether a footprint keeps clear of all members except the member `but` that it replaces."""
        room = self._room
        offset = room.centre_m[: self.count] - candidate.centre_m[0]
        reach = np.hypot(room.half_m[: self.count, 0], room.half_m[: self.count, 1]) + candidate.radius_m[0]
        reach = reach + np.maximum(room.gap_m[: self.count], candidate.gap_m[0])
        square = offset[:, 0] ** 2 + offset[:, 1] ** 2
        if self._spread_m or self._extent_m < np.inf:
            others = np.delete(square, [] if but is None else but)
            if np.any((others < self._spread_m**2) | (others > self._extent_m**2)):
                return False
        close = np.nonzero(square < reach * reach)[0]
        if but is not None:
            close = close[close != but]
        gap_m = np.maximum(room.gap_m[close], candidate.gap_m[0])
        # Whether circles inside the footprints are too close: a cheap test that settles most.
        inner = room.half_m[close].min(axis=1) + candidate.half_m[0].min() + gap_m
        if np.any(square[close] < (inner - 1e-9) ** 2):
            return False
        return len(close) == 0 or not bool(too_close(candidate, room[close])[0])

    def put(self, index: int, members: Footprints) -> None:
        """Let members take the places from `index` on."""
        room, places = self._room, slice(index, index + len(members))
        room.centre_m[places], room.heading_rad[places] = members.centre_m, members.heading_rad
        room.half_m[places], room.gap_m[places] = members.half_m, members.gap_m

    def admit(self, pool: Footprints, order: NDArray[np.intp], until: int) -> list[int]:
        """Admit from the pool, in that order, what fits.

        Returns the admitted indices, empty while fewer than `until` members stand.
        """
        admitted: list[int] = []
        for start in range(0, len(order), _AT_ONCE):
            if self.count == until:
                break
            indices = order[start : start + _AT_ONCE]
            admitted += indices[self._admit_some(pool[indices], until)].tolist()
        return admitted if self.count == until else []

    def _admit_some(self, candidates: Footprints, until: int) -> list[int]:
        """The candidates that were admitted, one after the other, until as many members stand."""
        clear, blocked = self._compared(candidates)
        admitted: list[int] = []
        done = 0
        # Most candidates are clear of all others: they are put in whole runs.
        for doubtful in (*np.flatnonzero(~clear).tolist(), len(candidates)):
            admitted += self._append(candidates, done, min(doubtful, done + until - self.count))
            done = doubtful + 1
            if self.count == until or doubtful == len(candidates):
                break
            if not blocked[doubtful] and self.fits(candidates[np.array([doubtful])]):
                admitted += self._append(candidates, doubtful, done)
        return admitted

    def _append(self, candidates: Footprints, start: int, end: int) -> range:
        self.put(self.count, candidates[np.arange(start, end)])
        self.count += end - start
        return range(start, end)

    def _compared(self, candidates: Footprints) -> tuple[Bools, Bools]:
        """(k,) which candidates fit whichever of those before them are admitted, and which do not fit beside those who
        stand already. Of the others `fits` decides.
        """
        others = joined([self.members(), candidates])
        offset = others.centre_m[None, :, :] - candidates.centre_m[:, None, :]
        square = offset[..., 0] ** 2 + offset[..., 1] ** 2
        gap_m = np.maximum(others.gap_m[None, :], candidates.gap_m[:, None])
        outer = others.radius_m[None, :] + candidates.radius_m[:, None] + gap_m
        inner = others.half_m.min(axis=1)[None, :] + candidates.half_m.min(axis=1)[:, None] + gap_m
        unwanted = (square < self._spread_m**2) | (square > self._extent_m**2)
        # Of the candidates only those that come before: everybody is too close to itself.
        before = np.arange(len(others))[None, :] < self.count + np.arange(len(candidates))[:, None]
        near = (unwanted | (square < outer * outer)) & before
        # As `fits` has it.
        hit = (unwanted | (square < (inner - 1e-9) ** 2))[:, : self.count]
        return ~np.asarray(near.any(axis=1)), np.asarray(hit.any(axis=1))


def reachable_means_m(distance_m: Floats, count: int) -> tuple[float, float]:
    """Least and greatest mean distance of `count` places out of those."""
    ordered = np.sort(distance_m)
    return float(ordered[:count].mean()), float(ordered[-count:].mean())


def members_at_mean(
    pool: Footprints,
    distance_m: Floats,
    crowd: ChosenMembers,
    count: int,
    mean_m: float,
    tolerance: float,
    rng: np.random.Generator,
) -> Footprints | None:
    """Members from a pool of places with a required mean distance; None when crowding keeps it from being reached.

    Places are drawn with weights exp(lambda * distance), lambda such that the weighted mean is the wanted one
    (the least change of the uniform distribution that has this mean); what is left of the error goes by
    exchanging members.
    """
    # A weighted draw without replacement (Efraimidis and Spirakis 2006). Weights that underflow to 0 would divide by
    # zero; their places come last either way.
    weight = np.maximum(_tilted_weights(distance_m, mean_m), 1e-300)
    lots = np.argsort(rng.exponential(size=len(weight)) / weight, kind="stable")
    chosen = crowd.admit(pool, lots, count)
    if not chosen:
        return None
    by_distance = np.argsort(distance_m, kind="stable")
    ordered = distance_m[by_distance]
    # Members move by at most a quarter of the range at a time, so that corrections are shared.
    stride = (ordered[-1] - ordered[0]) / 4.0
    taken = set(chosen)
    for _ in range(60 + 12 * count):
        short = mean_m * count - float(distance_m[chosen].sum())
        if abs(short) <= tolerance * mean_m * count:
            return crowd.members()
        member = int(rng.integers(count))
        # Clipped for the last steps of an extreme mean: they move this member by as much as there is.
        wanted = distance_m[chosen[member]] + np.clip(short, -stride, stride)
        start = int(np.searchsorted(ordered, np.clip(wanted, ordered[0], ordered[-1])))
        for index in by_distance[max(start - 3, 0) : start + 3].tolist():
            closer = abs(short - (distance_m[index] - distance_m[chosen[member]])) < abs(short)
            if closer and index not in taken and crowd.fits(pool[np.array([index])], but=member):
                taken.symmetric_difference_update({chosen[member], index})
                crowd.put(member, pool[np.array([index])])
                chosen[member] = index
                break
    return None


def _tilted_weights(distance_m: Floats, mean_m: float) -> Floats:
    """Weights exp(lambda * distance) with the wanted weighted mean, by bisection, held where out of reach."""
    centred = distance_m - distance_m.mean()
    # Per metre: at the ends the nearest or farthest places take nearly all of the weight.
    low, high = -0.5, 0.5
    for _ in range(40):
        middle = (low + high) / 2.0
        weight = _scaled_exponential(middle * centred)
        if float((weight * distance_m).sum() / weight.sum()) < mean_m:
            low = middle
        else:
            high = middle
    return _scaled_exponential(low * centred)


def _scaled_exponential(power: Floats) -> Floats:
    return np.asarray(np.exp(power - power.max()))

"""Footprints: oriented rectangles on the ground, many at a time, and the gaps between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Floats
from bench.simspec import Asset


@dataclass(frozen=True, slots=True)
class Footprints:
    """n rectangles: centres (n, 2) east/north, headings (n,) clockwise from north, half sizes (n, 2) along
    and across the heading, and the free gap (n,) that each requires around itself.
    """

    centre_m: Floats
    heading_rad: Floats
    half_m: Floats
    gap_m: Floats

    def __len__(self) -> int:
        return len(self.centre_m)

    def __getitem__(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Footprints:
        return Footprints(
            self.centre_m[which], self.heading_rad[which], self.half_m[which], self.gap_m[which]
        )

    @property
    def radius_m(self) -> Floats:
        """(n,) radii of the circles around the rectangles."""
        return np.hypot(self.half_m[:, 0], self.half_m[:, 1])

    def axes(self) -> Floats:
        """(n, 2, 2) unit vectors along and across the heading, east/north."""
        sine, cosine = np.sin(self.heading_rad), np.cos(self.heading_rad)
        axes: Floats = np.empty((len(self), 2, 2))
        axes[:, 0, 0], axes[:, 0, 1] = sine, cosine
        axes[:, 1, 0], axes[:, 1, 1] = cosine, -sine
        return axes

    def corners(self) -> Floats:
        """(n, 4, 2) corners in order around each rectangle."""
        signs = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
        offsets: Floats = (signs[None] * self.half_m[:, None, :]) @ self.axes()
        return self.centre_m[:, None, :] + offsets


def empty_footprints() -> Footprints:
    """No footprints."""
    return Footprints(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0))


def footprints(asset: Asset, centre_m: Floats, heading_deg: Floats, gap_m: float) -> Footprints:
    """Footprints of one asset at (n, 2) places with (n,) headings."""
    half = np.array([asset.length_m / 2.0, asset.width_m / 2.0])
    count = len(centre_m)
    return Footprints(centre_m, np.radians(heading_deg), np.tile(half, (count, 1)), np.full(count, gap_m))


def joined(parts: Sequence[Footprints]) -> Footprints:
    """Several footprints in one array."""
    if not parts:
        return empty_footprints()
    return Footprints(
        np.concatenate([part.centre_m for part in parts]),
        np.concatenate([part.heading_rad for part in parts]),
        np.concatenate([part.half_m for part in parts]),
        np.concatenate([part.gap_m for part in parts]),
    )


def gaps(first: Footprints, second: Footprints) -> Floats:
    """(m,) free distances between the i-th footprints of both, 0 where they touch or overlap.

    Separating axes tell whether two rectangles are apart; if so the nearest points include a corner of one of
    them.
    """
    offset = second.centre_m - first.centre_m
    first_axes, second_axes = first.axes(), second.axes()
    apart = np.zeros(len(first), dtype=bool)
    for axes in (first_axes, second_axes):
        along = np.abs(np.einsum("nsk,nk->ns", axes, offset))
        reach = _reach(axes, first_axes, first.half_m) + _reach(axes, second_axes, second.half_m)
        apart |= (along > reach).any(axis=1)
    # Two convex polygons apart are closest at a corner of one of them.
    nearest = np.minimum(_corner_distance(first, second), _corner_distance(second, first))
    return np.where(apart, nearest, 0.0)


def _reach(axes: Floats, own_axes: Floats, half_m: Floats) -> Floats:
    """(n, 2) half extents of rectangles with axes `own` along other `axes`."""
    projected: Floats = np.abs(np.einsum("nsk,nak->nsa", axes, own_axes))
    return np.asarray(np.einsum("nsa,na->ns", projected, half_m))


def _corner_distance(frame: Footprints, other: Footprints) -> Floats:
    """(n,) least distance of the corners of `other` to the rectangle `frame`."""
    local = np.einsum("nsk,nck->ncs", frame.axes(), other.corners() - frame.centre_m[:, None, :])
    outside = np.maximum(np.abs(local) - frame.half_m[:, None, :], 0.0)
    return np.asarray(np.hypot(outside[..., 0], outside[..., 1]).min(axis=1))


def too_close(candidates: Footprints, placed: Footprints) -> NDArray[np.bool_]:
    """(k,) whether a candidate is closer to a placed footprint than the larger of both gaps."""
    hit = np.zeros(len(candidates), dtype=bool)
    hit[too_close_pairs(candidates, placed)[0]] = True
    return hit


def too_close_pairs(candidates: Footprints, placed: Footprints) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The pairs that are closer than the larger of both gaps, as (m,) indices into both."""
    if len(placed) == 0 or len(candidates) == 0:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    wanted = np.maximum(candidates.gap_m[:, None], placed.gap_m[None, :])
    reach = candidates.radius_m[:, None] + placed.radius_m[None, :] + wanted
    offset = candidates.centre_m[:, None, :] - placed.centre_m[None, :, :]
    # Circles around the rectangles first: most pairs are far apart and skip the exact test.
    within_reach = np.einsum("ijk,ijk->ij", offset, offset) < reach * reach
    first, second = np.nonzero(within_reach)
    if len(first):
        gap = gaps(candidates[first], placed[second])
        # A gap of 0 still forbids overlap.
        hit = (gap == 0.0) | (gap < wanted[first, second])
        first, second = first[hit], second[hit]
    return first, second


def are_inside(guests: Footprints, hosts: Footprints) -> NDArray[np.bool_]:
    """(m,) whether the i-th guest lies wholly inside the i-th host."""
    local = np.einsum("nsk,nck->ncs", hosts.axes(), guests.corners() - hosts.centre_m[:, None, :])
    within: NDArray[np.bool_] = (np.abs(local) <= hosts.half_m[:, None, :]).all(axis=(1, 2))
    return within

"""The options that make weaker agents of the reference agent."""

from __future__ import annotations

import pytest

from agent_adapters.reference._agent import kept_detections
from bench.streams import BoundingBox2D, Detection2D, Detection2DArray, Header, Time


def frame(second: float, *names: str) -> Detection2DArray:
    """A frame with objects of these ids."""
    header = Header(stamp=Time.of(round(second * 1e9)))
    return Detection2DArray(header, tuple(Detection2D(header, (), BoundingBox2D(), name) for name in names))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_the_share_of_objects_is_kept_over_time(share: float) -> None:
    """Over many objects and moments the share is the stated one; what is kept is unchanged and in its order."""
    names = [f"t{number}" for number in range(40)]
    kept = [kept_detections(frame(3.0 * k, *names), share).detections for k in range(200)]
    assert sum(map(len, kept)) / 8000 == pytest.approx(share, abs=0.02)
    for k, detections in enumerate(kept):
        everything = frame(3.0 * k, *names).detections
        assert list(detections) == [detection for detection in everything if detection in detections]


def test_an_object_stays_or_is_lost_for_three_seconds() -> None:
    """Within a window all frames agree; over windows each object comes and goes."""
    seen = dict[int, set[frozenset[str]]]()
    for tenth in range(900):
        ids = {detection.id for detection in kept_detections(frame(tenth / 10, "t1", "t2"), 0.5).detections}
        seen.setdefault(tenth // 30, set()).add(frozenset(ids))
    assert all(len(views) == 1 for views in seen.values())
    for name in ("t1", "t2"):
        assert {name in next(iter(views)) for views in seen.values()} == {True, False}


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (1.0, 2)])
def test_the_ends_lose_everything_and_nothing(share: float, count: int) -> None:
    """No hash lies outside."""
    assert all(
        len(kept_detections(frame(3.0 * k, "t1", "t2"), share).detections) == count for k in range(200)
    )

"""Which tracks may be bystanders."""

from __future__ import annotations

from ._tracks import Track

# Below one half on purpose: an object that may well be a bystander is treated as one. Chosen, not measured.
BYSTANDER_SHARE = 0.3

# One frame may be a false detection. Chosen, not measured.
BYSTANDER_FRAMES = 2


def may_be_bystander(track: Track, classes: tuple[str, ...]) -> bool:
    """Whether it was seen often enough, and often enough as one of these classes."""
    return (
        track.frames >= BYSTANDER_FRAMES and sum(track.share(label) for label in classes) >= BYSTANDER_SHARE
    )

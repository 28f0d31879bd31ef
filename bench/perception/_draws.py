"""Sub-streams of the perception seed, each with the number of a frame as its next key."""

from __future__ import annotations

FRAME_DRAWS = 0
"""One block for the whole cast: misses, labels, scores and edges of boxes."""

FALSE_DRAWS = 1
"""False detections, which draw a varying count."""

# 2 belongs to the losses of degraded services, in bench.simulation.
MORE_FRAME_DRAWS = 3
"""A second block for the whole cast: drift of boxes and switches of identity. Apart from the first, whose width is part
of every recording that exists."""

LATENCY_DRAWS = 4
SURVIVAL_DRAWS = 5
"""Which false detections stay, and how they look in the next frame."""

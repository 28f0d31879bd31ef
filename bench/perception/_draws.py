"""Sub-streams of the perception seed, each with the number of a frame as its next key."""

from __future__ import annotations

from bench.simspec import Camera, Seeds, SimSpec, generator, seed_of

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

CAMERA_DRAWS = 6
"""A seed for each further camera, from which it has all of the above again."""


def seeds_of_camera(simspec: SimSpec, camera: Camera) -> Seeds:
    """The seeds with the perception seed of one camera: the SimSpec's for the main one."""
    # Deriving the stream's seed from the root takes a hash: done once here, not for every frame.
    seeds = simspec.seeds.model_copy(update={"perception": seed_of(simspec.seeds, "perception")})
    number = [each.name for each in simspec.vehicle.cameras].index(camera.name)
    if number == 0:
        return seeds
    # A seed and not a longer path: two cameras of equal frame numbers must not err alike.
    drawn = int(generator(seeds, "perception", CAMERA_DRAWS, number).integers(2**63))
    return seeds.model_copy(update={"perception": drawn})


def name_before_tracks(simspec: SimSpec, camera: Camera) -> str:
    """What the names of a camera's tracks begin with, so that no two cameras share one."""
    return "" if camera.name == simspec.vehicle.camera.name else f"{camera.name}/"

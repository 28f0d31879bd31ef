"""CPU milliseconds of a rendered frame on one core, and how many plain warps of the same size that is.

python benchmarks/camera_speed.py [RENDERER] [REPEATS]

The scene is a village with about 350 visible faces, seen obliquely from 38 m, in clear light with shadows. A plain warp is
one `cv2.warpPerspective` of a colour texture to the size of the picture, in the same run: milliseconds depend on the
machine and on what else runs on it, the ratio hardly does. RENDERER is an entry point of rebar.renderers, `opencv` when
absent; CPU time counts all threads of a driver.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from bench.camera import Conditions, RenderedFrame, actors_in, open_camera
from bench.camera.sheet import DAY, VILLAGE, VILLAGE_ROADS, pose_towards, simspec_with
from bench.contracts import OpenRenderer, load_plugin
from bench.simspec import DEFAULT_RENDERER, Camera

REPEATS, FRAMES = 15, 10
# What the renderer may cost for this scene on one core of the development machine, and what that is in plain warps.
LIMIT_MS = {(640, 480): 12.0, (1280, 720): 30.0}


def cpu_ms(work: Callable[[int], object], plain: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Least milliseconds of the work over several repeats, and the median of its ratio to plain warps beside each.

    What other processes add is no property of the renderer; it comes and goes, so both are timed by turns.
    """
    best, ratios = math.inf, []
    for _ in range(repeats):
        began = time.process_time()
        for _ in range(FRAMES):
            plain()
        between = time.process_time()
        for number in range(FRAMES):
            work(number)
        spent = time.process_time() - between
        best = min(best, spent / FRAMES)
        ratios.append(spent / (between - began))
    return best * 1e3, statistics.median(ratios)


def measure(
    width_px: int,
    height_px: int,
    conditions: Conditions,
    truth: str,
    plain: Callable[[], object],
    open_renderer: OpenRenderer,
    repeats: int,
) -> tuple[float, float]:
    """Milliseconds of a frame, and its ratio to a plain warp."""
    simspec = simspec_with(VILLAGE[:10], VILLAGE_ROADS)
    camera = open_camera(
        simspec,
        Camera(width_px=width_px, height_px=height_px),
        conditions=conditions,
        open_renderer=open_renderer,
    )
    assert simspec.realized is not None
    actors = simspec.realized.actors
    positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in actors])
    headings = np.radians(np.array([actor.heading_deg for actor in actors]))
    pose = replace(
        pose_towards(np.array((-30.0, -62.0, 38.0)), np.array((1.0, 4.0, 0.0))),
        velocity_enu_mps=np.array((4.0, 11.0, 0.0)),
    )

    def capture(number: int) -> RenderedFrame:
        moved = replace(pose, position_enu_m=pose.position_enu_m + 0.2 * number)
        frame = camera.capture(moved, positions, headings, number)
        assert frame is not None
        if truth == "boxes":
            actors_in(frame.picture)
        elif truth == "depth":
            frame.picture.depth_m()
        return frame

    return cpu_ms(capture, plain, repeats)


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    name = sys.argv[1] if len(sys.argv) > 1 else DEFAULT_RENDERER
    repeats = int(sys.argv[2]) if len(sys.argv) > 2 else REPEATS
    open_renderer: OpenRenderer = load_plugin("rebar.renderers", name)
    texture = np.random.default_rng(0).integers(0, 255, (2048, 2048, 3), np.uint8)
    oblique = np.array(((0.6, 0.15, 20.0), (0.02, 0.4, 30.0), (1e-5, 2e-4, 1.0)))
    for size, limit_ms in LIMIT_MS.items():
        limit = f", at most {limit_ms:g} ms" if name == DEFAULT_RENDERER else ""
        print(f"{name}, {size[0]}x{size[1]}{limit}")

        def plain(size: tuple[int, int] = size) -> object:
            return cv2.warpPerspective(texture, oblique, size)

        for label, conditions, truth in (
            ("clear", DAY, ""),
            ("clear, with boxes and mask", DAY, "boxes"),
            ("clear, with depth", DAY, "depth"),
            (
                "fog, rain, dirt, blur",
                replace(DAY, extinction_per_m=0.003, rain_level=6.0, lens_dirt=0.5, shutter_s=1 / 60),
                "",
            ),
        ):
            ms, ratio = measure(*size, conditions, truth, plain, open_renderer, repeats)
            print(f"  {size[0]}x{size[1]}, {label:28s} {ms:6.2f} ms {ratio:6.2f} plain warps")


if __name__ == "__main__":
    main()

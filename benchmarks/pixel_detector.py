"""CPU milliseconds of the detector that ships on one core, and how many plain warps of the same size that is.

python benchmarks/pixel_detector.py

The pictures are rendered, with some thirty objects in them. As in camera_speed.py, work and plain warp take turns:
milliseconds depend on the machine and on what else runs on it, the ratio hardly does. Where OpenCV has two engines for
networks, both are timed on the network alone.
"""

from __future__ import annotations

from functools import partial
from importlib.resources import files

import cv2
import numpy as np
from camera_speed import cpu_ms

from bench.arrays import Narrow
from bench.camera import open_camera
from bench.camera.sheet import DAY, VILLAGE, VILLAGE_ROADS, pose_towards, simspec_with
from bench.contracts import Pixels
from bench.perception.pixels import SmallDetector, open_small_detector
from bench.perception.pixels._decoding import cells_of
from bench.perception.pixels._model import WEIGHTS_NAME
from bench.simspec import Camera

SIZES = ((640, 480), (1280, 720))
# What a session with a camera of 640x480 at 5 Hz leaves for the detector, at 5 simulated seconds in a CPU second.
LIMIT_MS = {(640, 480): 19.0}


def picture_of(width_px: int, height_px: int) -> Pixels:
    """A village from 38 m."""
    simspec = simspec_with(VILLAGE, VILLAGE_ROADS)
    camera = open_camera(simspec, Camera(width_px=width_px, height_px=height_px), conditions=DAY)
    assert simspec.realized is not None
    actors = simspec.realized.actors
    positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in actors])
    headings = np.radians(np.array([actor.heading_deg for actor in actors]))
    frame = camera.capture(
        pose_towards(np.array((-30.0, -62.0, 38.0)), np.array((1.0, 4.0, 0.0))), positions, headings, 0
    )
    assert frame is not None
    return frame.bgr


def repeat(detector: SmallDetector, bgr: Pixels, _: int) -> object:
    """One picture through the detector."""
    return detector.detect(bgr)


def forward(net: cv2.dnn.Net, cells: Narrow, _: int) -> object:
    """One picture through the network alone."""
    net.setInput(cells)
    return net.forward()


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    detector = open_small_detector(simspec_with(()))
    texture = np.random.default_rng(0).integers(0, 255, (2048, 2048, 3), np.uint8)
    oblique = np.array(((0.6, 0.15, 20.0), (0.02, 0.4, 30.0), (1e-5, 2e-4, 1.0)))
    engines = {
        name: getattr(cv2.dnn, name) for name in ("ENGINE_CLASSIC", "ENGINE_NEW") if hasattr(cv2.dnn, name)
    }
    # A path, because OpenCV 5.0.0 heeds the choice of an engine for files alone.
    weights = str(files("bench.perception.pixels") / WEIGHTS_NAME)
    for size in SIZES:
        bgr = picture_of(*size)

        def plain(size: tuple[int, int] = size) -> object:
            return cv2.warpPerspective(texture, oblique, size)

        limit = f", at most {LIMIT_MS[size]:g} ms" if size in LIMIT_MS else ""
        print(f"{size[0]}x{size[1]}, {len(detector.detect(bgr))} detections{limit}")
        ms, ratio = cpu_ms(partial(repeat, detector, bgr), plain)
        print(f"  {'detector':20s} {ms:6.2f} ms {ratio:6.2f} plain warps")
        cells = cells_of(bgr, 32)
        for name, engine in engines.items():
            net = cv2.dnn.readNetFromONNX(weights, engine=engine)

            ms, ratio = cpu_ms(partial(forward, net, cells), plain)
            print(f"  {name:20s} {ms:6.2f} ms {ratio:6.2f} plain warps")


if __name__ == "__main__":
    main()

"""An example of another renderer behind the protocol: a ray caster that shares nothing with the default one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from camera_stages import cast_rays, pose, stage

import bench.camera
from bench.arrays import Floats, Narrow
from bench.camera import Conditions, RenderedCamera, actors_in
from bench.contracts import CameraPose, Labels, Picture, Pixels, Renderer, Stage
from bench.simspec import Seeds


@dataclass(frozen=True, slots=True, eq=False)
class CastPicture:
    """The `Picture` contract over arrays."""

    bgr: Pixels
    labels: Labels
    depths: Narrow
    silhouettes: dict[int, int]

    def instances(self) -> Labels:
        return self.labels

    def depth_m(self) -> Narrow:
        return self.depths

    def silhouette_px(self, actor: int) -> int:
        return self.silhouettes[actor]


class RayCaster:
    """The `Renderer` contract: flat colours, exact occlusion."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        ground = stage.ground.texture.mean(axis=(0, 1))
        self._colours = np.array([ground, *(look.colours_bgr.mean(axis=0) for look in stage.looks)])

    def render(self, pose: CameraPose, positions_enu_m: Floats, headings_rad: Floats) -> Picture:
        labels, depths = cast_rays(self._stage, pose, positions_enu_m, headings_rad)
        silhouettes = {}
        for actor in range(len(self._stage.looks)):
            alone = Stage(
                self._stage.lens, self._stage.ground, self._stage.light, (self._stage.looks[actor],)
            )
            only = slice(actor, actor + 1)
            silhouettes[actor] = int(
                (cast_rays(alone, pose, positions_enu_m[only], headings_rad[only])[0] == 1).sum()
            )
        colours = np.asarray(self._colours[labels], np.uint8)
        colours[np.isinf(depths)] = 200
        return CastPicture(colours, labels, depths.astype(np.float32), silhouettes)


def open_ray_caster(stage: Stage) -> Renderer:
    return RayCaster(stage)


def test_another_renderer_serves_the_same_camera() -> None:
    """Boxes and sensor effects come from the bench, whatever drew the picture."""
    scene, positions, headings = stage([("truck", 0.0, 0.0, 30.0), ("man", 4.0, 3.0, 0.0)])
    view = pose((0.0, -25.0, 18.0), 0.0, 38.0)
    silent = Conditions(1.0, 0.0, noise=0.0)
    frames = []
    for conditions in (silent, Conditions(1.0, 0.0, noise=4.0)):
        camera = RenderedCamera(scene, conditions, Seeds(root=3), open_ray_caster)
        frame = camera.capture(view, positions, headings, 0)
        assert frame is not None
        frames.append(frame)

    assert [actor.actor for actor in actors_in(frames[0].picture)] == [0, 1]
    assert 0.9 < actors_in(frames[0].picture)[0].visible <= 1.0
    assert (frames[0].bgr == frames[0].picture.bgr).all()
    assert 2.0 < (frames[1].bgr.astype(int) - frames[0].bgr).std() < 8.0


def test_opencv_is_imported_where_pixels_are_wanted() -> None:
    """A session without pixels pays nothing for them: in other rooms of the core a function imports what imports cv2."""
    core = Path(bench.camera.__file__).parents[1]
    outside = {
        path.relative_to(core).as_posix(): path.read_text(encoding="utf-8")
        for path in core.rglob("*.py")
        if not path.is_relative_to(core / "camera")
        and not path.is_relative_to(core / "perception" / "pixels")
    }
    pixels = re.compile(
        r"^(?:from|import) (?:cv2|bench\.camera|\.+camera|\S*\bpixels|\S*_frame_pixels)\b", re.MULTILINE
    )
    assert [name for name, text in outside.items() if pixels.search(text)] == [
        "reporting/pictures/_frame_pixels.py"
    ]

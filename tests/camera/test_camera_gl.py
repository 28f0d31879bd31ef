"""The renderer `moderngl`, compared with ray casting and with the default renderer. Without OpenGL most of it is skipped."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from camera_stages import NOON, Placement, cast_rays, lens, pose, stage
from gl_renderer import PACKAGE, declare, needs_gl, open_moderngl_renderer
from scipy.ndimage import binary_erosion, minimum_filter

from bench.arrays import Bools, Floats
from bench.camera import Conditions, actors_in, open_opencv_renderer
from bench.camera.sheet import SceneActor, simspec_with
from bench.contracts import CameraPose, ChecksHost, Labels, NamesBuild, Picture, Stage
from bench.errors import SetupError
from bench.simulation import camera_faults

VILLAGE: list[Placement] = [
    ("house", 0.0, 14.0, 20.0),
    ("apartment-block", -22.0, 26.0, 100.0),
    ("civilian-car", 4.0, 3.0, 70.0),
    ("radar-vehicle", -9.0, 0.0, 10.0),
    ("tree", 9.0, 6.0, 0.0),
    ("bus", 12.0, -8.0, 160.0),
    # Halfway inside the bus: no order of faces draws both.
    ("crate-stack", 12.5, -6.0, 30.0),
    ("man", -1.0, 6.5, 0.0),
    ("tent", -13.0, -11.0, 120.0),
]
VIEWS = [
    pose((-3.0, -40.0, 20.0), 4.0, 28.0),
    pose((35.0, 25.0, 14.0), 240.0, 22.0, 12.0),
    pose((2.0, -16.0, 3.0), 350.0, 5.0, -8.0),
    pose((1.0, 1.0, 40.0), 30.0, 90.0),
]


def drawn(scene: Stage, view: CameraPose, positions: Floats, headings: Floats) -> Picture:
    return open_moderngl_renderer(scene).render(view, positions, headings)


def inner(labels: Labels) -> Bools:
    """Pixels whose neighbours show the same actor."""
    return np.asarray(minimum_filter(labels, 3) == -minimum_filter(-labels.astype(int), 3), np.bool_)


@needs_gl
def test_masks_and_depths_are_those_of_ray_casting() -> None:
    """Pixel by pixel, also where two solids run into each other: a pixel belongs to whom its middle shows."""
    scene, positions, headings = stage(VILLAGE, camera=lens(160, 120, 150.0))
    renderer = open_moderngl_renderer(scene)
    for view in VIEWS:
        picture = renderer.render(view, positions, headings)
        labels, depths = cast_rays(scene, view, positions, headings)
        same = picture.instances() == labels
        finite = same & np.isfinite(depths) & (depths < 500.0)
        wrong_m = np.abs(picture.depth_m()[finite] - depths[finite])

        assert len(np.unique(labels)) >= 7
        assert same.mean() > 0.9995
        # The rays know nothing of windows, which lie up to some centimetres before their wall.
        assert (wrong_m < 1e-3 * depths[finite]).mean() > 0.99
        assert (wrong_m < 0.02 * depths[finite]).mean() > 0.9999
        assert np.isinf(picture.depth_m()[np.isinf(depths) & same]).all()


@needs_gl
def test_it_draws_what_the_default_renderer_draws() -> None:
    """The same village: masks agree away from outlines, and colours are close where shadows do not differ."""
    conditions = Conditions(math.radians(75.0), math.radians(200.0))
    apart = [actor for actor in VILLAGE if actor[0] != "crate-stack"]
    scene, positions, headings = stage(apart, conditions, lens(320, 240, 300.0))
    renderers = open_moderngl_renderer(scene), open_opencv_renderer(scene)
    checked = 0
    for view in VIEWS:
        ours, default = (renderer.render(view, positions, headings) for renderer in renderers)
        labels = default.instances()
        away = inner(labels) & inner(ours.instances())
        assert (ours.instances() == labels)[away].mean() > 0.99
        difference = np.abs(ours.bgr.astype(int) - default.bgr).max(axis=-1)
        ground = away & (labels == 0)
        assert (difference[ground] <= 6).mean() > 0.9
        for actor in actors_in(default):
            inside = binary_erosion(labels == actor.actor + 1, iterations=2)
            if inside.sum() > 60:
                checked += 1
                # Objects shade themselves and each other here, so only the larger part of each is alike.
                assert np.median(difference[inside]) <= 12, (actor.actor, np.median(difference[inside]))
        assert {actor.actor for actor in actors_in(ours)} <= {actor.actor for actor in actors_in(default)}
    assert checked >= 12


@needs_gl
def test_equal_arguments_give_equal_pixels_whatever_was_drawn_before() -> None:
    scene, positions, headings = stage(VILLAGE, camera=lens(200, 150, 190.0))
    first, second = (open_moderngl_renderer(scene) for _ in range(2))
    early = second.render(VIEWS[1], positions, headings)
    pictures = [renderer.render(VIEWS[0], positions, headings) for renderer in (first, second)]

    assert (pictures[0].bgr == pictures[1].bgr).all()
    assert (pictures[0].instances() == pictures[1].instances()).all()
    assert (pictures[0].depth_m() == pictures[1].depth_m()).all()
    # The truth of an earlier picture is still its own after another one was drawn and everybody moved.
    again = drawn(scene, VIEWS[1], positions, headings)
    positions += 3.0
    assert (early.instances() == again.instances()).all()
    assert (early.bgr == again.bgr).all()


@needs_gl
def test_shadows_fall_on_the_ground_as_far_as_they_must_and_on_objects() -> None:
    """Under a sun at 30 degrees in the south, a house's shadow darkens the northern neighbour's lower part alone."""
    sun = Conditions(math.radians(30.0), math.radians(180.0))
    view = pose((16.0, -2.0, 12.0), 290.0, 25.0)
    camera = lens(320, 240, 260.0)
    # The block is three storeys high, and 12 m away from the white wall that it shades.
    pair: list[Placement] = [("van", 0.0, 6.0, 90.0), ("apartment-block", 0.0, -16.0, 90.0)]
    scene, positions, headings = stage(pair, sun, camera)
    shaded = drawn(scene, view, positions, headings)
    far = positions.copy()
    far[1] = (0.0, -400.0, 0.0)
    lit = drawn(scene, view, far, headings)
    van = binary_erosion((shaded.instances() == 1) & (lit.instances() == 1), iterations=2)
    darker = (lit.bgr.astype(int) - shaded.bgr).mean(axis=-1)

    assert van.sum() > 150
    assert (darker[van] > 15).mean() > 0.3
    default = [
        open_opencv_renderer(scene).render(view, place, headings).bgr.astype(int)
        for place in (positions, far)
    ]
    assert np.abs(default[0] - default[1])[van].max() <= 2, "the default renderer shades the ground alone"


@needs_gl
def test_it_names_the_driver_on_which_its_pixels_rest() -> None:
    scene, _, _ = stage([])
    renderer = open_moderngl_renderer(scene)
    assert isinstance(renderer, NamesBuild)
    assert renderer.build.startswith("moderngl ")
    assert "OpenGL" in renderer.build


class _NoDriver:
    """The package where there is no EGL."""

    @staticmethod
    def create_standalone_context(**settings: object) -> None:
        raise Exception("libEGL.so not loaded\nmore lines")


def gl_faults() -> list[str]:
    """The faults of a SimSpec whose camera wants the renderer."""
    spec = simspec_with([SceneActor("van", 0.0, 0.0, 0.0)], ())
    camera = spec.vehicle.camera.model_copy(update={"renderer": "moderngl"})
    vehicle = spec.vehicle.model_copy(update={"camera": camera})
    return [str(fault) for fault in camera_faults(spec.model_copy(update={"vehicle": vehicle}))]


def test_without_opengl_the_field_and_the_fix_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the package is missing, and where it finds no driver; the entry point itself imports neither."""
    declare(monkeypatch)
    assert isinstance(open_moderngl_renderer, ChecksHost)
    scene, _, _ = stage([], NOON)
    monkeypatch.setitem(sys.modules, "moderngl", None)
    with pytest.raises(SetupError, match=r"moderngl is not installed \(pip install moderngl, or leave"):
        open_moderngl_renderer(scene)
    faults = gl_faults()
    assert len(faults) == 1
    assert faults[0].startswith("vehicle.camera.renderer: the package moderngl is not installed (")
    assert "opencv draws" in faults[0]
    monkeypatch.setitem(sys.modules, "moderngl", _NoDriver)
    (fault,) = gl_faults()
    assert fault.startswith(
        "vehicle.camera.renderer: OpenGL 4.3 cannot be opened through EGL (libEGL.so not loaded"
    )


JOIN = """
import json, sys
sys.modules["moderngl"] = None
from bench.camera.sheet import simspec_with
from bench.contracts import package_of
from bench.simulation import camera_faults
spec = simspec_with([])
camera = spec.vehicle.camera.model_copy(update={"renderer": "moderngl"})
vehicle = spec.vehicle.model_copy(update={"camera": camera})
faults = camera_faults(spec.model_copy(update={"vehicle": vehicle}))
print(json.dumps([package_of("rebar.renderers", "moderngl"), *map(str, faults)]))
"""


@pytest.mark.process
def test_installed_from_outside_it_is_found_by_its_name(tmp_path: Path) -> None:
    """By pip, into a folder of its own: the bench asks the package whether it can draw here."""
    install = "install --quiet --disable-pip-version-check --no-build-isolation --no-deps --no-index --target"
    subprocess.run(
        [sys.executable, "-m", "pip", *install.split(), str(tmp_path), str(PACKAGE)],
        check=True,
        capture_output=True,
    )
    code = f"import site; site.addsitedir({str(tmp_path)!r})" + JOIN
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    package, fault = json.loads(done.stdout)
    assert package == "rebar-gl"
    assert fault.startswith("vehicle.camera.renderer: the package moderngl is not installed (")

"""Looks: every asset has one, of the size of the catalogue, drawn from its faces generator."""

from __future__ import annotations

import numpy as np
import pytest
from camera_stages import PLAIN_BGR, look, member

from bench.camera import look_of, look_tables
from bench.errors import SetupError
from bench.simspec import ASSETS


def test_every_asset_has_a_look_of_several_solids_and_no_look_lacks_an_asset() -> None:
    assert set(look_tables()) == set(ASSETS)
    for asset in ASSETS:
        assert look(asset).geometry.solids.max() >= 1, asset


def test_looks_have_the_size_of_the_catalogue() -> None:
    """No draw leaves the asset's footprint and height, and the largest draw of several fills both."""
    for name, asset in ASSETS.items():
        size = np.array((asset.length_m, asset.width_m, asset.height_m))
        extents = []
        for seed in range(12):
            corners = look(name, seed).geometry.corners_m.reshape(-1, 3)
            assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-9)
            assert (np.abs(corners[:, :2]).max(axis=0) * 2 <= size[:2] + 0.03).all(), name
            extents.append(np.ptp(corners, axis=0))
        assert np.max(extents, axis=0) == pytest.approx(size, abs=0.05), name


def test_normals_point_outwards_and_faces_are_flat_and_convex() -> None:
    for name in ASSETS:
        shape = look(name).geometry
        for solid in range(int(shape.solids.max()) + 1):
            faces = (shape.solids == solid) & ~shape.details
            middle = shape.corners_m[faces].reshape(-1, 3).mean(axis=0)
            offsets = (shape.normals[faces] * shape.corners_m[faces, 0]).sum(axis=1)
            assert (shape.normals[faces] @ middle <= offsets + 1e-9).all(), name
            # Convex: no corner of the solid lies beyond the plane of one of its faces.
            heights = shape.normals[faces] @ shape.corners_m[faces].reshape(-1, 3).T - offsets[:, None]
            assert heights.max() < 0.02, f"{name}, solid {solid}"


def test_actors_differ_by_their_draws_and_only_by_them() -> None:
    first, again, other = look("civilian-car", 1), look("civilian-car", 1), look("civilian-car", 5)

    assert first.geometry is again.geometry
    assert (first.colours_bgr == again.colours_bgr).all()
    assert np.abs(first.colours_bgr - other.colours_bgr).max() > 30


def test_concealment_covers_and_takes_the_colour_of_the_ground() -> None:
    ground = np.array(PLAIN_BGR, float)
    for asset in ("radar-vehicle", "soldier"):
        open_look, hidden = look(asset), look(asset, concealment=1.0)
        assert hidden.geometry.solids.max() > open_look.geometry.solids.max()
        count = len(open_look.colours_bgr)
        farther = np.abs(open_look.colours_bgr - ground).mean()
        assert np.abs(hidden.colours_bgr[:count] - ground).mean() < 0.6 * farther


def test_an_asset_without_a_look_is_named() -> None:
    ghost = member("crate").model_copy(update={"asset": "ghost"})
    with pytest.raises(SetupError, match="no look for the asset 'ghost'"):
        look_of(ghost, 0.0, np.random.default_rng(0), np.zeros(3))

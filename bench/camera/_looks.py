"""How each asset looks: solids, paints, postures and sizes from the tables in `looks/`, concealed as a group asks.

docs/camera.md describes the tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import Field

from bench.arrays import Bools, Floats, product
from bench.contracts import CastMember, Geometry, Look
from bench.documents import Document, load_document
from bench.errors import SetupError
from bench.simspec import ASSETS, Asset, AssetLook, Panels, Solid

from ._concealment import concealed
from ._solids import Face, circle, geometry_of, loft, rectangle

_TABLES = Path(__file__).parent / "looks"
_COLORS: dict[str, str] = {
    "black": "#202224", "blue": "#2050b0", "brown": "#6a4428", "green": "#2e7a3e", "grey": "#808488", "orange": "#f07818",
    "pink": "#f078b0", "purple": "#7a3a9a", "red": "#c82828", "silver": "#c4c8cc", "white": "#f0f0ec", "yellow": "#f0cc28",
}  # fmt: skip
_COLORED = frozenset(
    [
        "body",
        "bus",
        "cab",
        "car",
        "canvas",
        "dress",
        "fur",
        "hide",
        "leaves",
        "needles",
        "olive",
        "shirt",
        "tank",
        "timber",
        "uniform",
        "vest",
        "wall",
        "wool",
    ]
)
"""The paints that a stated colour replaces: what people would call the colour of the thing. Chosen for the tables as they are; `body` for assets of others."""
_SIDES = ("right", "front", "left", "back")  # in the order of a rectangle's edges
_BOX = AssetLook(
    paints={"body": ("#808488",)},
    postures={"box": (Solid(box=(0.0, 1.0, 0.0, 1.0, 0.0, 1.0), paint="body"),)},
)
"""Of an asset without a look; stretched to its size."""


class LookTable(Document):
    """One file of `looks/`."""

    paints: dict[str, tuple[str, ...]] = Field({}, description="Paints that all looks may use.")
    parts: dict[str, tuple[Solid, ...]] = {}
    looks: dict[str, AssetLook]


@cache
def look_tables() -> dict[str, tuple[AssetLook, LookTable]]:
    """Every asset's look with the table that it stands in, by the asset's name."""
    looks: dict[str, tuple[AssetLook, LookTable]] = {}
    for path in sorted(_TABLES.glob("*.yaml")):
        table = load_document(path, LookTable)
        looks |= {name: (look, table) for name, look in table.looks.items()}
    return looks


def look_of(member: CastMember, concealment: float, random: np.random.Generator, ground_bgr: Floats) -> Look:
    """One actor's look, with draws from `random`; the same number of draws for every asset."""
    own = member.own.model_dump_json() if member.own else ""
    _, look, table = _drawn(member.asset, own)
    posture, size, seed = (float(value) for value in random.random(3))
    chosen = list(look.postures)[int(posture * len(look.postures))]
    scale = look.sizes[int(size * len(look.sizes))]
    level = round(min(1.0, max(0.0, concealment)) * 4.0)
    geometry, paints, glows = _geometry(member.asset, own, chosen, scale, level)
    colours = np.random.Generator(np.random.PCG64(int(seed * 2**32)))
    return Look(
        geometry, _coloured(paints, look, table, level / 4.0, colours, ground_bgr, member.color), glows
    )


def _coloured(
    paints: Sequence[str],
    look: AssetLook,
    table: LookTable,
    concealment: float,
    random: np.random.Generator,
    ground_bgr: Floats,
    stated: str | None,
) -> Floats:
    """(f, 3) the colours of faces. With a stated colour as many are drawn, so that others stay as they are."""
    palette = {
        name: _bgr(options[int(random.random() * len(options))])
        for name, options in sorted((table.paints | look.paints).items())
    }
    if stated is not None:
        palette |= dict.fromkeys(_COLORED & palette.keys(), _bgr(_COLORS[stated]))
    colours = np.array([palette[paint] if paint in palette else _bgr(paint) for paint in paints])
    # No two faces are worn alike; without it, flat colours look drawn.
    colours *= random.uniform(0.94, 1.06, (len(colours), 1))
    if concealment:
        # Camouflage takes the colours of the ground, in blotches.
        mottled = (
            ground_bgr
            * random.uniform(0.62, 1.12, (len(colours), 1))
            * random.uniform(0.92, 1.08, (len(colours), 3))
        )
        colours += 0.85 * concealment * (mottled - colours)
    return np.asarray(np.clip(colours, 0.0, 255.0), np.float64)


def _drawn(asset: str, own: str) -> tuple[Asset, AssetLook, LookTable]:
    """The size and look of an asset of the catalogue, or of the one with `own` for JSON text."""
    if own:
        definition = Asset.model_validate_json(own)
        return definition, definition.look or _BOX, LookTable(looks={})
    looks = look_tables()
    if asset not in looks:
        raise SetupError(
            "camera looks",
            f"there is no look for the asset {asset!r}",
            f"the tables have {', '.join(sorted(looks))}",
        )
    return ASSETS[asset], *looks[asset]


# By the text: two SimSpecs may have different assets of one name.
@cache
def _geometry(
    asset: str, own: str, posture: str, scale: float, level: int
) -> tuple[Geometry, tuple[str, ...], Bools]:
    """The geometry of an asset, the paint of each face, and which faces shine at night."""
    size, look, table = _drawn(asset, own)
    solids = list(_solids(look.postures[posture], table))
    first = list(_solids(next(iter(look.postures.values())), table))
    factors, offset = _fit(solids, first, size)
    if not np.isfinite(factors).all():
        raise SetupError(f"assets.{asset}.look", "its solids are flat", "give them length, width and height")
    # Cover is drawn for the asset, not for the draw of an actor, so that geometries stay few.
    cover = concealed(
        look.cover, level / 4.0, (size.length_m * scale, size.width_m * scale, size.height_m * scale), asset
    )
    shaped = [
        [Face((face.corners_m + offset) * factors * scale, face.detail) for face, _, _ in solid]
        for solid in solids
    ] + [part.faces for part in cover]
    paints = [paint for solid in solids for _, paint, _ in solid]
    glows = [shines for solid in solids for _, _, shines in solid]
    for part in cover:
        paints += [part.paint] * len(part.faces)
        glows += [False] * len(part.faces)
    return geometry_of(shaped), tuple(paints), np.array(glows, dtype=np.bool_)


PaintedFace = tuple[Face, str, bool]


def _fit(
    solids: list[list[PaintedFace]], upright: list[list[PaintedFace]], asset: Asset
) -> tuple[Floats, Floats]:
    """(3,) factors and offset that give a posture the catalogue's footprint around its foot point.

    The height is that of the first posture: who kneels is lower than who stands.
    """
    low, high = _bounds(solids)
    heights = _bounds(upright)
    extents = np.array((*(high - low)[:2], (heights[1] - heights[0])[2]))
    with np.errstate(divide="ignore"):
        factors = np.array((asset.length_m, asset.width_m, asset.height_m)) / extents
    return factors, np.array((-(low[0] + high[0]) / 2.0, -(low[1] + high[1]) / 2.0, -low[2]))


def _bounds(solids: list[list[PaintedFace]]) -> tuple[Floats, Floats]:
    every = np.concatenate([face.corners_m for solid in solids for face, _, _ in solid])
    return every.min(axis=0), every.max(axis=0)


def _solids(specs: Sequence[Solid], table: LookTable) -> Iterator[list[PaintedFace]]:
    for spec in specs:
        for copy in range(spec.repeat.count if spec.repeat else 1):
            step = np.array(spec.repeat.step if spec.repeat else (0.0, 0.0, 0.0)) * copy
            for flipped in (False, True) if spec.mirror else (False,):
                if spec.use is not None:
                    parts = _solids(table.parts[spec.use], table)
                else:
                    parts = iter([_faces(spec)])
                for solid in parts:
                    yield [(_placed(face, spec, step, flipped), paint, glows) for face, paint, glows in solid]


def _placed(face: Face, spec: Solid, step: Floats, flipped: bool) -> Face:
    corners = face.corners_m
    if spec.pivot is not None:
        roll, pitch, yaw = (math.radians(angle) for angle in spec.turn_deg)
        turn = product(product(_about(2, yaw), _about(1, pitch)), _about(0, roll))
        corners = product(corners - spec.pivot, turn.T) + spec.pivot
    corners = corners + spec.shift + step
    if flipped:
        corners = corners * (1.0, -1.0, 1.0)
    return Face(corners, face.detail)


def _about(axis: int, angle: float) -> Floats:
    sine, cosine = math.sin(angle), math.cos(angle)
    turn = np.eye(3)
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    turn[i, i] = turn[j, j] = cosine
    turn[i, j], turn[j, i] = -sine, sine
    return turn


def _faces(spec: Solid) -> list[PaintedFace]:
    rings = _rings(spec)
    faces: list[PaintedFace] = [(face, spec.paint, False) for face in loft(rings)]
    if spec.top_paint is not None:
        highest = max(range(len(faces)), key=lambda index: float(faces[index][0].corners_m[:, 2].mean()))
        faces[highest] = (faces[highest][0], spec.top_paint, False)
    for panels in spec.panels:
        faces += _panels(panels, rings)
    return faces


def _rings(spec: Solid) -> list[Floats]:
    if spec.box is not None:
        x0, x1, y0, y1, z0, z1 = spec.box
        return [rectangle(x0, x1, y0, y1, z0), rectangle(x0, x1, y0, y1, z1)]
    if spec.frustum is not None:
        return [rectangle(*spec.frustum[:5]), rectangle(*spec.frustum[5:])]
    if spec.lathe is not None:
        return [
            circle(radius, height, spec.lathe.sides) + spec.lathe.at for radius, height in spec.lathe.profile
        ]
    if spec.extrusion is not None:
        outline = np.array(spec.extrusion.outline)
        return [np.insert(outline, 1, y, axis=1) for y in spec.extrusion.y]
    assert spec.cylinder is not None
    shape = spec.cylinder
    end = shape.radius if shape.end_radius is None else shape.end_radius
    rings = [circle(shape.radius, -shape.length / 2, shape.sides), circle(end, shape.length / 2, shape.sides)]
    # Columns move so that the cylinder's own axis becomes the wanted one.
    columns = {"x": (2, 0, 1), "y": (1, 2, 0), "z": (0, 1, 2)}[shape.axis]
    return [ring[:, columns] + shape.at for ring in rings]


_LIFT_M = 0.01
"""Panels lie this far in front of their side, so that they count as seen whenever the side is."""


def _panels(panels: Panels, rings: Sequence[Floats]) -> Iterator[PaintedFace]:
    lower, upper = rings
    if panels.side == "top":
        quad = upper
    else:
        i = _SIDES.index(panels.side)
        j = (i + 1) % 4
        quad = np.array((lower[i], lower[j], upper[j], upper[i]))
    normal = np.cross(quad[1] - quad[0], quad[2] - quad[0])
    quad = quad + normal / np.sqrt(product(normal, normal)) * _LIFT_M
    left, right, bottom, top = panels.area
    number = 0
    for row in range(panels.rows):
        for column in range(panels.columns):
            u = [
                left + (right - left) * (column + 0.5 + side * panels.fill[0] / 2) / panels.columns
                for side in (-1, 1)
            ]
            v = [
                bottom + (top - bottom) * (row + 0.5 + side * panels.fill[1] / 2) / panels.rows
                for side in (-1, 1)
            ]
            corners = np.array(
                [_on(quad, a, b) for a, b in ((u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1]))]
            )
            # A fixed pattern of lit windows that looks like chance.
            yield Face(corners, detail=True), panels.paint, panels.glows and (number * 7 + row * 3) % 5 < 2
            number += 1


def _on(quad: Floats, u: float, v: float) -> Floats:
    point: Floats = (quad[0] * (1 - u) + quad[1] * u) * (1 - v) + (quad[3] * (1 - u) + quad[2] * u) * v
    return point


def _bgr(text: str) -> Floats:
    """Blue, green, red of #rrggbb. Raises SetupError for anything else: a paint that no table has."""
    try:
        value = int(text.removeprefix("#"), 16)
        if not text.startswith("#") or len(text) != 7:
            raise ValueError(text)
    except ValueError:
        raise SetupError(
            "camera looks", f"there is no paint {text!r}", "name a paint of the table, or write #rrggbb"
        ) from None
    return np.array((value & 255, value >> 8 & 255, value >> 16), dtype=np.float64)

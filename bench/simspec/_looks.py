"""How an asset looks, as a document: solids in metres, their paints, postures and sizes. `bench.camera` draws them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document

MAX_CORNERS = 12
"""Corners of the largest face, which bounds the sides of a cylinder. Twelve look round at any range that is drawn."""

Triple = tuple[float, float, float]
Paint = Annotated[str, Field(min_length=1)]
_COLOR = re.compile(r"#[0-9a-fA-F]{6}\Z")


class Cylinder(Document):
    """A cylinder, or with `end_radius` a cone, around the axis through its middle."""

    at: Triple = Field(description="The middle.")
    axis: Literal["x", "y", "z"] = "z"
    radius: float = Field(gt=0.0)
    end_radius: float | None = Field(None, ge=0.0)
    length: float = Field(gt=0.0)
    sides: int = Field(8, ge=3, le=MAX_CORNERS)


class Lathe(Document):
    """A convex body of revolution: radii over heights from below, upright at a point."""

    at: Triple = (0.0, 0.0, 0.0)
    profile: tuple[tuple[float, float], ...] = Field(min_length=2, description="Radius and height.")
    sides: int = Field(6, ge=3, le=MAX_CORNERS)


class Extrusion(Document):
    """A convex outline in the plane of x and z, drawn out along y."""

    outline: tuple[tuple[float, float], ...] = Field(min_length=3, max_length=MAX_CORNERS)
    y: tuple[float, float]


class Repetition(Document):
    """Copies of a solid, each one step further."""

    count: int = Field(ge=2, le=40)
    step: Triple


class Panels(Document):
    """Rectangles on one side of a box or frustum: windows, doors, lamps, signs.

    `area` is left, right, bottom and top as shares of the side; `fill` the share of each cell of the grid.
    """

    side: Literal["front", "back", "left", "right", "top"]
    area: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0)
    columns: int = Field(1, ge=1, le=40)
    rows: int = Field(1, ge=1, le=40)
    fill: tuple[float, float] = (1.0, 1.0)
    paint: Paint
    glows: bool = Field(False, description="Whether about half of the panels shine at night.")


class Solid(Document):
    """One convex solid in metres, with exactly one shape; or `use`, the name of a part."""

    box: tuple[float, float, float, float, float, float] | None = Field(
        None, description="x from and to, y from and to, z from and to."
    )
    frustum: tuple[float, float, float, float, float, float, float, float, float, float] | None = Field(
        None, description="x, x, y, y, z of the lower rectangle, then of the upper one."
    )
    cylinder: Cylinder | None = None
    lathe: Lathe | None = None
    extrusion: Extrusion | None = None
    use: str | None = None
    paint: Paint = "#808080"
    top_paint: Paint | None = Field(None, description="Paint of the upper face, where it differs.")
    panels: tuple[Panels, ...] = ()
    turn_deg: Triple = Field((0.0, 0.0, 0.0), description="Roll, pitch (nose down) and yaw (to the left).")
    pivot: Triple | None = Field(None, description="The point that a turn leaves in place.")
    shift: Triple = (0.0, 0.0, 0.0)
    mirror: bool = Field(False, description="Whether a copy stands on the other side (y to -y).")
    repeat: Repetition | None = None

    @model_validator(mode="after")
    def _has_one_shape(self) -> Self:
        shapes = ("box", "frustum", "cylinder", "lathe", "extrusion", "use")
        if sum(getattr(self, name) is not None for name in shapes) != 1:
            raise ValueError(f"a solid needs exactly one of {', '.join(shapes)}")
        if self.panels and self.box is None and self.frustum is None:
            raise ValueError("only a box or a frustum has sides for panels")
        if any(self.turn_deg) and self.pivot is None:
            raise ValueError("a turned solid needs a pivot")
        return self

    def every_paint(self) -> Iterator[str]:
        """The paints of the solid and of its panels."""
        yield self.paint
        if self.top_paint is not None:
            yield self.top_paint
        yield from (panels.paint for panels in self.panels)


class AssetLook(Document):
    """All looks of one asset. Each actor draws a posture, a size and a colour for each of its paints."""

    paints: dict[str, tuple[str, ...]] = Field({}, description="Colours (#rrggbb) that a paint may have.")
    sizes: tuple[Annotated[float, Field(gt=0.5, le=1.0)], ...] = Field(
        (1.0,), min_length=1, description="Sizes as shares of the catalogue's."
    )
    cover: Literal["net", "foliage", "none"] = Field(
        "none", description="What conceals the asset, beside paint."
    )
    postures: dict[str, tuple[Solid, ...]] = Field(min_length=1)

    def require_own_parts(self) -> None:
        """Raises ValueError for a part of another table, and for a paint that is neither of `paints` nor #rrggbb."""
        for posture, solids in self.postures.items():
            for index, solid in enumerate(solids):
                where = f"look.postures.{posture}[{index}]"
                if solid.use is not None:
                    raise ValueError(f"{where}.use: there are no parts here; write the solid itself")
                for paint in solid.every_paint():
                    if paint not in self.paints and not _COLOR.match(paint):
                        known = ", ".join(self.paints) or "none"
                        raise ValueError(
                            f"{where}: no paint {paint!r}; look.paints has: {known}; or write #rrggbb"
                        )
        for name, colors in self.paints.items():
            if wrong := [color for color in colors if not _COLOR.match(color)] or not colors:
                raise ValueError(
                    f"look.paints.{name}: {wrong if colors else 'no colour'}; write colours as #rrggbb"
                )

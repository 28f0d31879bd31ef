"""Assets: size, class label, look and role of kinds of actor, by name. The catalogue ships; files and packages add to it."""

from __future__ import annotations

from functools import cache
from math import sqrt
from pathlib import Path
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from bench.documents import Document, load_document
from bench.errors import Fault, SetupError

from ._looks import AssetLook
from ._quantities import Identifier, Positive, RosName
from ._roles import Role

# Positions are rounded to the millimetre, so a guest that fits exactly would have no position left.
CLEARANCE_M = 0.002


class Asset(Document):
    """One kind of actor: what a simulation, a camera, a detector and the rules need to know of it."""

    class_label: RosName = Field(description="What perfect perception reports.")
    length_m: Positive = Field(description="Outer size along the heading.")
    width_m: Positive
    height_m: Positive
    role: Role | None = Field(None, description="Of groups that state none.")
    confused_with: tuple[RosName, ...] = Field(
        (), description="Class labels that degraded perception may report in place of its own."
    )
    solid: bool = Field(False, description="Whether it hides what is behind it, and blocks ways.")
    possible_false_alarm: bool = Field(
        True, description="Whether a false detection may carry its class label."
    )
    look: AssetLook | None = Field(
        None,
        description="How a camera draws it. Without one: a box of its size, grey or in the group's colour.",
    )

    def __hash__(self) -> int:
        # Caches are keyed by assets, and what is generated would ask the mappings of a look.
        return hash((self.class_label, self.length_m, self.width_m, self.height_m))

    @model_validator(mode="after")
    def _look_is_complete(self) -> Self:
        if self.look is not None:
            self.look.require_own_parts()
        return self

    def has_room_for(self, guest: Asset) -> bool:
        """Whether the guest's footprint fits into this one at some heading, with a clearance of two
        millimetres.

        Source: Carver, "Rectangles within rectangles", Mathematics Magazine 30, 1957. A guest longer than the
        host can still fit diagonally.
        """
        long, short = max(self.length_m, self.width_m), min(self.length_m, self.width_m)
        p, q = (
            max(guest.length_m, guest.width_m) + CLEARANCE_M,
            min(guest.length_m, guest.width_m) + CLEARANCE_M,
        )
        if p <= long:
            return q <= short
        diagonal = p * p + q * q
        return q <= short and short * diagonal >= 2 * p * q * long + (p * p - q * q) * sqrt(
            diagonal - long * long
        )


class AssetTable(Document):
    """A file of assets, as `bench/simspec/assets.yaml` is."""

    assets: dict[Identifier, Asset] = Field(min_length=1)


ASSETS = load_document(Path(__file__).with_name("assets.yaml"), AssetTable).assets
"""The catalogue."""

CLASS_LABELS = tuple(sorted({asset.class_label for asset in ASSETS.values()}))
"""Every class label of the catalogue."""


@cache
def packaged_assets() -> dict[str, Asset]:
    """The assets of installed packages: an entry point of group `rebar.assets` is the path of a file of them.

    Raises SetupError for a file that does not fit, and for a name that two files have, or the catalogue.
    """
    # Looking for packages costs every process tens of milliseconds; most situations have the catalogue's assets alone.
    from bench.plugins import load_plugin, package_of, plugins

    found: dict[str, Asset] = {}
    for entry in sorted(plugins("rebar.assets")):
        path, package = load_plugin("rebar.assets", entry), package_of("rebar.assets", entry)
        if not isinstance(path, str | Path):
            what = f"{entry!r} of {package} is {path!r}, and no path of a file"
            raise SetupError("rebar.assets", what, "let the entry point name a pathlib.Path")
        table = load_document(path, AssetTable).assets
        if twice := sorted(table.keys() & (ASSETS.keys() | found.keys())):
            what = f"the catalogue or another package has assets of these names: {', '.join(twice)}"
            raise SetupError(f"{path} (package {package})", what, "name them otherwise")
        found |= table
    return found


def _of_file(value: object, info: ValidationInfo) -> object:
    """The content of the file that is named in place of a mapping of assets."""
    if not isinstance(value, str):
        return value
    folder = (info.context or {}).get("folder")
    if folder is None:
        raise ValueError("a file of assets can be named only in a file; write the assets themselves here")
    return load_document(folder / value, AssetTable).assets


OwnAssets = Annotated[dict[Identifier, Asset], BeforeValidator(_of_file)]
"""Assets by name; in a file also the path of an AssetTable, relative to that file."""


def asset_fault(where: str, asset: str) -> Fault | None:
    """The fault of naming an asset that the catalogue does not have; None for an asset that it has."""
    if asset in ASSETS:
        return None
    return Fault(
        where,
        f"there is no asset {asset!r}",
        f"the catalogue has {', '.join(ASSETS)}; others stand in the SimSpec's assets, or in a package",
    )

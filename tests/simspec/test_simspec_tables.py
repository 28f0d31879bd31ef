"""The lists of key factors and assets in docs/simspec.md are those of the code."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from bench.simspec import ASSETS, FACTORS, Asset

PAGE = Path(__file__).parents[2] / "docs" / "simspec.md"
URGENCY = "_order_urgency_per_min"


def factor_rows() -> list[str]:
    """The list of key factors, line by line; the orders' own urgencies share a line of the page."""
    return [
        f"- `{name}` ({factor.unit}): {factor.text}"
        for name, factor in FACTORS.items()
        if not name.endswith(URGENCY)
    ]


def orders_with_urgency() -> list[str]:
    return [name.removesuffix(URGENCY) for name in FACTORS if name.endswith(URGENCY)]


def asset_rows() -> list[str]:
    """The table of assets, a row for those that share class label, confusions and solidity."""

    def kind(item: tuple[str, Asset]) -> tuple[str, tuple[str, ...], bool]:
        return item[1].class_label, item[1].confused_with, item[1].solid

    rows = []
    for (label, confused_with, solid), members in groupby(sorted(ASSETS.items(), key=kind), kind):
        sizes = "; ".join(f"`{name}` {a.length_m:g}x{a.width_m:g}x{a.height_m:g}" for name, a in members)
        rows.append(
            f"| `{label}`{', solid' if solid else ''} | {sizes} | {', '.join(confused_with) or '-'} |"
        )
    return rows


def test_page_has_every_key_factor() -> None:
    """When this fails, put the lines of `factor_rows()` into the page, and the orders into their line."""
    words = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert " ".join(factor_rows()) in words
    assert ", ".join(f"`{order}`" for order in orders_with_urgency()) in words


def test_page_has_every_asset() -> None:
    """When this fails, put the rows of `asset_rows()` into the page."""
    assert "\n".join(asset_rows()) in PAGE.read_text(encoding="utf-8")

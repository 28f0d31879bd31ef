"""The tables of key factors and assets in docs/simspec.md are those of the code."""

from __future__ import annotations

from pathlib import Path

from bench.simspec import ASSETS, FACTORS

PAGE = Path(__file__).parents[2] / "docs" / "simspec.md"


def factor_rows() -> list[str]:
    """The table of key factors, line by line."""
    rows = [
        f"| `{name}` | {factor.unit} | {factor.text} | `{factor.path}` |" for name, factor in FACTORS.items()
    ]
    return ["| key factor | unit | meaning | fields |", "| --- | --- | --- | --- |", *rows]


def asset_rows() -> list[str]:
    """The table of assets, line by line."""
    rows = [
        f"| `{name}` | `{asset.class_label}` | {asset.length_m:g} x {asset.width_m:g} x {asset.height_m:g} "
        f"| {', '.join(asset.confused_with) or '-'} | {'yes' if asset.solid else 'no'} |"
        for name, asset in ASSETS.items()
    ]
    return [
        "| asset | class label | length x width x height, m | confused with | solid |",
        "| --- | --- | --- | --- | --- |",
        *rows,
    ]


def test_page_has_every_key_factor() -> None:
    """When this fails, put the rows of `factor_rows()` into the page."""
    assert "\n".join(factor_rows()) in PAGE.read_text(encoding="utf-8")


def test_page_has_every_asset() -> None:
    """When this fails, put the rows of `asset_rows()` into the page."""
    assert "\n".join(asset_rows()) in PAGE.read_text(encoding="utf-8")

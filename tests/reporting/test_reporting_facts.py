"""What the report says of a situation: the places of its groups in words."""

from __future__ import annotations

import polars as pl

from bench.documents import read_document
from bench.reporting._data import ReportData
from bench.reporting._facts import describe
from bench.simspec import SimSpec

SPEC = """name: places
world:
  area: {corners: [{east_m: 0, north_m: 0}, {east_m: 100, north_m: 0}, {east_m: 100, north_m: 100}]}
  areas: [{id: village, corners: [{east_m: 1, north_m: 1}, {east_m: 90, north_m: 1}, {east_m: 90, north_m: 90}]}]
actors:
- {id: houses, asset: house, role: clutter, count: 2, placement: {inside: {area: village}}}
- {id: people, asset: civilian, role: bystander, count: 3, placement: {inside: {of: houses}, near: {of: home, max_m: 80}}}
- {id: guards, asset: soldier, role: adversary, count: 1, placement: {between: {first: houses, second: houses}}}
- {id: cars, asset: civilian-car, role: clutter, count: 1,
   placement: {between: {first: home, second: people}, facing: {heading_deg: 90}}}
"""


def test_the_report_says_where_groups_stand() -> None:
    """Inside an area or a house, between two, by the compass."""
    spec = read_document(SPEC, SimSpec)
    data = ReportData("x", "", (), (), (), {}, (), pl.DataFrame(), {}, (), {"one": spec}, {}, "d", None, {})
    said = {fact.name: fact.text for fact in describe(data)}

    assert said["Actors: houses"] == "2 house, clutter, inside village"
    assert said["Actors: people"] == "3 civilian, bystander, 0 to 80 m from home, inside houses"
    assert said["Actors: guards"] == "1 soldier, adversary, between two of houses"
    assert said["Actors: cars"] == "1 civilian-car, clutter, between home and people, heading 90°"

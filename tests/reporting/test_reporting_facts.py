"""What the report says of a situation: the places of its groups in words."""

from __future__ import annotations

import polars as pl

from bench.documents import read_document
from bench.reporting._campaign_data import ReportData
from bench.reporting.text._campaign_facts import campaign_facts
from bench.simspec import SimSpec

SPEC = """name: places
world:
  area: {corners: [{east_m: 0, north_m: 0}, {east_m: 100, north_m: 0}, {east_m: 100, north_m: 100}]}
  roads: [{id: main, points: [{east_m: 0, north_m: 0}, {east_m: 90, north_m: 90}]}]
  areas: [{id: village, corners: [{east_m: 1, north_m: 1}, {east_m: 90, north_m: 1}, {east_m: 90, north_m: 90}]}]
actors:
- {id: houses, asset: house, role: clutter, count: 2, placement: {inside: {area: village}}}
- {id: people, asset: civilian, role: bystander, count: 3, placement: {inside: {of: houses}, near: {of: home, max_m: 80}}}
- {id: guards, asset: soldier, role: adversary, count: 1, placement: {between: {first: houses, second: houses}}}
- {id: hikers, asset: civilian, role: sought, count: 2,
   placement: {avoid: [{area: village}, {of: clutter, at_least_m: 4}], counts: [{area: village, at_most: 1}], extent_m: 9}}
- {id: cars, asset: civilian-car, role: clutter, count: 1,
   placement: {between: {first: home, second: people}, facing: {heading_deg: 90}}}
- {id: patrol, asset: soldier, role: adversary, count: 2, motion: {kind: patrol, speed_mps: 1.5, route: [{east_m: 5, north_m: 2}, {east_m: 9, north_m: 2}]},
   placement: {along: {road: main, where: beside, at_least_m: 2, within_m: 9}, hidden_from: {of: home},
               distances: [{of: bystander, min_m: 10}, {point: {east_m: 5, north_m: 3}, max_m: 40}], spread_m: 2}}
orders: [{id: stay, at_s: 60, kind: hold}]
outages: [{kind: operator_link, at_s: 20, duration_s: 30}]
vehicle: {failures: [{at_s: 40, kind: gps_off, duration_s: 10}]}
intelligence: [{id: seen, about: guards, latency_s: 120, delivered_s: 15}]
rules: {max_speed_mps: 8, link_lost: hold, bystander_slow_within_m: 20, bystander_slow_mps: 3, report_windows: [{from_s: 10, until_s: 90}]}
"""


def test_facts_describe_the_situation() -> None:
    spec = read_document(SPEC, SimSpec)
    data = ReportData("x", "", (), (), (), {}, (), pl.DataFrame(), {}, (), {"one": spec}, {}, "d", None, {})
    texts = {fact.name: fact.text for fact in campaign_facts(data)}

    assert texts["Actors: houses"] == "2 house, clutter, inside village"
    assert texts["Actors: people"] == "3 civilian, bystander, 0 to 80 m from home, inside houses"
    assert texts["Actors: guards"] == "1 soldier, adversary, between two of houses"
    assert texts["Actors: cars"] == "1 civilian-car, clutter, between home and people, heading 90°"
    assert texts["Actors: hikers"] == (
        "2 civilian, sought, outside village, 4 m or more clear of every clutter, at most 1 of them inside village, "
        "at most 9 m from one to another"
    )
    assert texts["Actors: patrol"] == (
        "2 soldier, adversary, 10 m or more from every bystander, 0 to 40 m from 5, 3 m, beside main, 2 to 9 m off it, "
        "hidden from home, 2 m apart or more, patrolling 2 points at 1.5 m/s"
    )
    assert texts["Intelligence"] == "seen: priority 1, within 60 m, 120 s old, delivered at 15 s"
    assert texts["Events"] == "20 s operator link away for 30 s; 40 s gps off for 10 s; 60 s order hold"
    assert texts["Rules"] == (
        "no mark within 50 m of bystanders; reports from confidence 0.6 on; height up to 120 m; 20% of charge kept; "
        "no faster than 8 m/s; 3 m/s within 20 m of bystanders; reports only from 10 to 90 s; hold after 10 s without the operator"
    )

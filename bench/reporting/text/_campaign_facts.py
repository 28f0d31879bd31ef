"""What was run, line by line: situation, factors, provenance."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import polars as pl

from bench.contracts import FirmwareBuild, Outcome, StepTiming
from bench.simspec import FACTORS, SimSpec, agent_name

from .._campaign_data import Configuration, ReportData
from .._simspec_files import situations_of
from ..statistics._sensor import perception_in_short
from ._format import listed, plural
from ._situation import events_text, group_text, intelligence_text, rules_text

# Chosen: a fact stays a line or two.
SHOWN_VALUES = 6
ROWS_AT_ONCE = 20_000
"""Rows of a score table that are written as CSV together. Chosen: some 3 MB of text."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One line about what was run; `varied` when it is not the same in every run."""

    name: str
    text: str
    varied: bool = False


def _fog(simspec: SimSpec) -> str:
    level, visibility_m = (
        simspec.perception.model.fog_level(simspec.environment),
        simspec.environment.visibility_m,
    )
    return f"{level:.3g}" if visibility_m is None else f"{level:.3g}, visibility {visibility_m:g} m"


_SITUATION: tuple[tuple[str, Callable[[SimSpec], str]], ...] = (
    ("Area of interest", lambda s: f"{s.world.area.area_m2 / 1e6:.3g} km²"),
    ("Start", lambda s: f"{s.environment.start_utc:%Y-%m-%d %H:%M} UTC"),
    ("Fog level", _fog),
    ("Rain level", lambda s: f"{s.environment.rain_level:g}"),
    (
        "Wind",
        lambda s: (
            f"{s.environment.wind.speed_mps:g} m/s, gusts scaled by {s.environment.wind.turbulence_mps:g} m/s"
        ),
    ),
    ("Vehicle", lambda s: f"{s.vehicle.model} with {s.vehicle.autopilot}"),
    (
        "Mission",
        lambda s: (
            f"{s.mission.altitude_m:g} m high at {s.mission.speed_mps:g} m/s, at most {s.mission.time_limit_s:g} s"
        ),
    ),
    ("Rules", lambda s: rules_text(s.rules)),
    ("Events", events_text),
    ("Perception", lambda s: perception_in_short(s.perception)),
    ("Pace", lambda s: s.pace.mode),
)


def campaign_facts(data: ReportData) -> list[Fact]:
    """The campaign and its situation, line by line."""
    simulated_s = sum(run.simulated_s for run in data.runs)
    cpu_s = sum(run.cpu_s for run in data.runs)
    facts = [
        Fact(
            "Sessions",
            f"{len(data.runs)}, {simulated_s:.0f} simulated seconds, {cpu_s:.0f} CPU seconds of this machine",
        ),
        Fact("Agents", listed(data.agents) or "none"),
        Fact("Under study", ", ".join(data.study) or "nothing"),
        Fact("Design", _design(data)),
        *_shard(data),
        *_pace_override(data),
        *_firmware(data),
        *_real_time(data),
    ]
    if not data.simspecs:
        return [*facts, Fact("Situation", "no SimSpec is here")]
    situation: dict[str, set[str]] = {name: set() for name, _ in _SITUATION}
    groups: dict[str, set[str]] = {}
    present: Counter[str] = Counter()
    intelligence: set[str] = set()
    # Once through: each may be read from its file.
    for _, spec in situations_of(data.simspecs):
        for name, read in _SITUATION:
            situation[name].add(read(spec))
        for group in spec.actors:
            groups.setdefault(group.id, set()).add(group_text(group, spec.world.area.area_m2))
            present[group.id] += 1
        intelligence.add(intelligence_text(spec))
    facts += [_fact_over_runs(name, texts) for name, texts in situation.items()]
    for group_id, texts in groups.items():
        absent = {"none"} if present[group_id] < len(data.simspecs) else set()
        facts.append(_fact_over_runs(f"Actors: {group_id}", texts | absent))
    return [*facts, _fact_over_runs("Intelligence", intelligence)]


def _shard(data: ReportData) -> list[Fact]:
    shard = data.campaign.get("shard")
    return [Fact("Shard", f"{shard}: a part of the campaign; `rebar merge` joins all parts")] if shard else []


def _pace_override(data: ReportData) -> list[Fact]:
    agents = [agent for agent in data.campaign.get("agents", ()) if agent.get("pace")]
    paces = {f"the runs of {agent_name(agent['manifest'])}": agent["pace"] for agent in agents}
    if pace := data.campaign.get("pace"):
        paces = {("all other runs" if paces else "all runs"): pace} | paces
    if not paces:
        return []
    repeats = {
        "realtime": "; at the pace realtime a run does not repeat bit for bit",
        "warp": "; at the pace warp a run repeats as far as the order of the agent's own threads does",
    }
    texts = [f"{runs} at {pace}" for runs, pace in paces.items()]
    doubts = [repeats[pace] for pace in sorted({*paces.values()} & repeats.keys())]
    return [
        Fact("Pace override", f"{', '.join(texts)}, in place of the pace of the situations{''.join(doubts)}")
    ]


def _firmware(data: ReportData) -> list[Fact]:
    """The real autopilots that flew; nothing where all were imitated."""
    texts = [build.description for run in data.runs if (build := run.fact(FirmwareBuild))]
    return [_fact_over_runs("Autopilot firmware", texts)] if texts else []


def _real_time(data: ReportData) -> list[Fact]:
    """How punctual the runs in real time were, and what was lost on their links; nothing where none was in real time."""
    timings = [timing for run in data.runs if (timing := run.fact(StepTiming))]
    if not timings:
        return []
    steps, late = sum(timing.steps for timing in timings), sum(timing.late for timing in timings)
    worst = max(timings, key=lambda timing: timing.late_share)
    slow = sum(run.outcome is Outcome.BENCH_TOO_SLOW for run in data.runs)
    punctuality = (
        f"{late:,} of {steps:,} steps in {plural(len(timings), 'run')} were late, at most {worst.late_share:.1%} in one run; "
        f"99 % of the steps of each run began at most {max(timing.delay_p99_s for timing in timings) * 1e3:.1f} ms late; "
        f"{plural(slow, 'run')} too slow to count"
    )
    lost: Counter[str] = Counter()
    for run in data.runs:
        if run.fact(StepTiming):
            lost.update(run.losses)
    losses = ", ".join(f"{count:,} {what}" for what, count in sorted(lost.items())) or "none"
    return [Fact("Real time", punctuality), Fact("Losses on links in real time", losses)]


def _design(data: ReportData) -> str:
    design = data.campaign.get("design")
    if not isinstance(design, Mapping):
        return "not stated"
    method = design.get("method")
    kind = str(method.get("kind", "full_factorial")) if isinstance(method, Mapping) else "full_factorial"
    points = plural(len({run.design_point for run in data.runs}), "design point")
    return f"{kind.replace('_', ' ')}, {points}, {plural(len({run.scene for run in data.runs}), 'scene')}, replicates included"


def _fact_over_runs(name: str, texts: Iterable[str]) -> Fact:
    # By number: 10 follows 9, not 1.
    different = sorted(set(texts), key=_numeric_order)
    more = f" · and {len(different) - SHOWN_VALUES} more" if len(different) > SHOWN_VALUES else ""
    return Fact(name, " · ".join(different[:SHOWN_VALUES]) + more, len(different) > 1)


def _numeric_order(text: str) -> tuple[float, str]:
    head = text.split(" ", 1)[0]
    try:
        return (float(head), text)
    except ValueError:
        return (0.0, text)


def factor_rows(data: ReportData) -> list[dict[str, str]]:
    """The factors of the design, as the campaign states them."""
    design = data.campaign.get("design")
    stated = design.get("factors") if isinstance(design, Mapping) else None
    factors = stated if isinstance(stated, list) else []
    return [_factor(factor) for factor in factors if isinstance(factor, Mapping)]


def _factor(stated: Mapping[str, Any]) -> dict[str, str]:
    levels, span, sets = stated.get("levels"), stated.get("range"), stated.get("sets")
    if isinstance(levels, list) and levels:
        text = ", ".join(str(level) for level in levels)
    elif isinstance(span, Mapping):
        text = f"{span.get('low')} to {span.get('high')}"
    else:
        text = str(stated.get("formula") or "–")
    text += f" when {stated['when']}" if stated.get("when") else ""
    unit = f" {stated['unit']}" if stated.get("unit") else ""
    paths = list(map(str, sets)) if isinstance(sets, list) else []
    patches = stated.get("patches")
    patched = (
        [str(path) for patch in patches.values() for path in patch] if isinstance(patches, Mapping) else []
    )
    return {
        "name": str(stated.get("name", "")),
        "levels": text + unit,
        "sets": ", ".join(dict.fromkeys(paths + patched)) or "–",
    }


def factor_levels(configuration: Configuration) -> str:
    """The varied key factors of the situations that make up a configuration, and its runs by agent."""
    factors = [
        f"{name.replace('_', ' ').removesuffix(' m').removesuffix(' per km2')} "
        f"{', '.join(f'{value:g}' for value in values)}{_unit(name)}"
        for name, values in configuration.factors.items()
        if values
    ]
    runs = [f"{agent} {count}" for agent, count in configuration.runs.items() if count]
    return " · ".join([*factors, f"runs: {', '.join(runs)}"])


def _unit(factor: str) -> str:
    unit = FACTORS[factor].unit
    return "" if unit in ("1", "level") else f" {unit.replace('1/km2', 'per km²')}"


def _digest_of(scores: pl.DataFrame) -> str:
    """SHA-256 of a score table as CSV, written in parts: as one text, a large table would be more than the page."""
    digest = hashlib.sha256()
    for number, rows in enumerate(scores.iter_slices(ROWS_AT_ONCE) if scores.height else [scores]):
        digest.update(rows.write_csv(include_header=number == 0).encode())
    return digest.hexdigest()


def provenance_of(data: ReportData) -> list[Fact]:
    """Where the numbers come from: digests of the decomposition and of the scores, versions, seeds."""
    design = data.campaign.get("design")
    seed = design.get("seed") if isinstance(design, Mapping) else None
    versions = data.manifest.get("versions")
    stated = sorted(versions.items()) if isinstance(versions, Mapping) else []
    # Of the content as CSV: Parquet files with equal rows may differ in their bytes.
    digest = _digest_of(data.scores)
    return [
        Fact("Decomposition", data.decomposition or "not stated"),
        Fact("SHA-256 of the decomposition", data.decomposition_sha256 or "not known"),
        Fact("Versions", ", ".join(f"{name} {version}" for name, version in stated) or "not on record"),
        Fact("Seed of the design", "not stated" if seed is None else str(seed)),
        Fact("Rows of the score table", str(data.scores.height)),
        Fact("SHA-256 of the score table as CSV", digest),
        Fact(
            "Recordings here",
            f"{sum(run.recording is not None for run in data.runs)} of {plural(len(data.runs), 'run')}",
        ),
    ]

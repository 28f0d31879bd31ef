"""Sessions behind the bridge to MQTT, in a process of their own, which imports no more than they need."""

from __future__ import annotations

from pathlib import Path

from bench.agents import open_agent
from bench.campaign.execution._flight import AgentStarter
from bench.contracts import AgentManifest, Record, SessionResult
from bench.simspec import SimSpec
from bench.simulation import SessionPlan, run_session


def fly_manifest(
    manifest: AgentManifest, spec: SimSpec, home: Path, scratch: Path
) -> tuple[SessionResult, list[Record], str]:
    """How a session ended, its records, and what bridge and agent printed. `home`: where the manifest lies."""
    records: list[Record] = []
    starter = AgentStarter(open_agent)
    end = run_session(SessionPlan(spec, manifest, home, starter.open, scratch, records.append))
    return end, records, (starter.output or b"").decode()

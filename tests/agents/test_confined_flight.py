"""A session with a confined agent is the session: the same records, whichever rung it is on."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
import zenoh
from host_image import PYTHON, image_or_skip
from rungs import CONFINING, rung_or_skip

import bench
from bench.agents import load_manifest, open_agent
from bench.contracts import Outcome, Record
from bench.realization import place
from bench.simspec import load_simspec
from bench.simulation import SessionPlan, run_session

ROOMS = ("bench", "agent_adapters", "vehicle_models")
EXAMPLE = Path(__file__).parents[2] / "examples" / "search.yaml"


@cache
def flown(rung: str, folder: Path) -> list[Record]:
    """The records of 15 simulated seconds with the reference agent."""
    spec = load_simspec(EXAMPLE)
    spec = place(spec.model_copy(update={"mission": spec.mission.model_copy(update={"time_limit_s": 15.0})}))
    manifest, manifest_folder = load_manifest(spec.agent.manifest)
    records: list[Record] = []
    confined = manifest
    if rung == "container":
        # The image has Python alone: packages come from this host, as a developer's image would not.
        source = Path(bench.__file__).parents[1]
        packages = Path(zenoh.__file__).parents[1]
        confined = confined.model_copy(
            update={
                "image": image_or_skip(),
                "command": (PYTHON, *manifest.command[1:]),
                "environment": manifest.environment | {"PYTHONPATH": f"{source}:{packages}"},
                "read": (*(str(source / room) for room in ROOMS), str(packages)),
            }
        )
    with rung_or_skip(rung) as isolation:
        confined = confined.model_copy(update={"isolation": isolation})
        end = run_session(SessionPlan(spec, confined, manifest_folder, open_agent, folder, records.append))
    assert end.outcome in (Outcome.COMPLETED, Outcome.TIME_LIMIT), end.reason
    return records


@pytest.mark.parametrize("rung", [*CONFINING, "container"])
def test_confinement_changes_no_record(rung: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Each rung against none, record by record; imports of an editable installation work in each."""
    free = flown("none", tmp_path_factory.getbasetemp() / "free")
    assert len(free) > 100
    assert flown(rung, tmp_path_factory.mktemp(rung)) == free

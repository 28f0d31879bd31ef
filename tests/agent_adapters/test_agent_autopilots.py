"""The shipped agents on every autopilot: both imitations, and firmware on the links of the real ones."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from firmware_files import install_firmware

from bench import load_simspec, place
from bench.campaign import load_measurable_decomposition
from bench.campaign.execution._flight import fly_here
from bench.contracts import Outcome, SessionResult
from bench.simspec import AgentSpec, RealAutopilot

pytestmark = pytest.mark.flight
SEARCH = Path(__file__).parents[2] / "examples" / "search.yaml"
REAL = {"px4": "REBAR_PX4", "ardupilot": "REBAR_ARDUCOPTER"}
HOME, LOOKED, REPORTED = "OBS-204", "OBS-091", "OBS-201"


def flown(
    folder: Path, autopilot: str | RealAutopilot, agent: str = "reference-naive", limit_s: float | None = None
) -> SessionResult:
    base = load_simspec(SEARCH)
    mission = base.mission if limit_s is None else base.mission.model_copy(update={"time_limit_s": limit_s})
    # So long that no test meets one by a slow host.
    budgets = base.budgets.model_copy(update={"wall_s": 3000.0, "connect_s": 600.0, "reply_s": 600.0})
    vehicle = base.vehicle.model_copy(update={"autopilot": autopilot})
    changes = {"vehicle": vehicle, "agent": AgentSpec(manifest=agent), "mission": mission, "budgets": budgets}
    spec = place(base.model_copy(update=changes))
    return fly_here(spec, load_measurable_decomposition("search-and-report"), folder, "flight")


def values(result: SessionResult) -> dict[str, float | None]:
    return {observation.observable: observation.x for observation in result.observations}


def test_the_reference_agent_searches_with_ardupilot(tmp_path: Path) -> None:
    """It finds the target, tells where it is, and comes home, in time."""
    result = flown(tmp_path, "ardupilot")
    check_search(result, whole=True)
    # The imitation's flights are equal to the last bit.
    assert values(result)["OBS-201"] == 1.0
    # With PX4 the mission takes 140 s.
    assert result.simulated_s < 150.0


@pytest.mark.process
@pytest.mark.parametrize(
    ("kind", "agent", "limit_s"),
    [
        ("px4", "null-random", 28.0),
        # It boots for 50 s, 800 samples each.
        pytest.param(
            "ardupilot", "reference-naive", None, marks=[pytest.mark.slow, pytest.mark.timeout(1800)]
        ),
    ],
)
def test_agents_fly_behind_the_links_of_firmware(
    kind: str, agent: str, limit_s: float | None, tmp_path: Path
) -> None:
    """The bench's imitation as a program in the place of the real one: one flies a whole search. Of the other something comes
    into view: flights behind its links are those of tests/vehicle_models.
    """
    firmware = install_firmware(tmp_path / "firmware", kind, imitates=True)
    autopilot = RealAutopilot(kind=kind, firmware=str(firmware))
    check_search(flown(tmp_path / "run", autopilot, agent, limit_s), whole=limit_s is None)


@pytest.mark.real
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kind", list(REAL))
def test_the_reference_agent_searches_with_a_real_autopilot(kind: str, tmp_path: Path) -> None:
    if not os.environ.get(REAL[kind]):
        pytest.skip(f"{REAL[kind]} is not set: it names the real autopilot's place (docs/real-autopilots.md)")
    check_search(flown(tmp_path, RealAutopilot(kind=kind, firmware=os.environ[REAL[kind]])), whole=True)


def check_search(result: SessionResult, *, whole: bool) -> None:
    observed = values(result)
    if not whole:
        assert result.outcome is Outcome.TIME_LIMIT, result.reason
        assert observed[LOOKED]
        return
    assert result.outcome is Outcome.COMPLETED, result.reason
    assert observed[HOME] == 1.0
    assert observed[LOOKED]
    assert observed[REPORTED] == 1.0, "both targets that intelligence names"

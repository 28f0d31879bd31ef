"""A package from outside that adds one plug-in to each family, with nothing but contracts and entry points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.contracts import MeasureRequest, Observation, Option, Prediction, Tape
from bench.errors import Fault
from bench.simspec import SimSpec
from bench.simulation import open_plain_scene as open_scene  # noqa: F401
from bench.testing import open_still_vehicle as open_vehicle  # noqa: F401


def highest_share(observable: str, tape: Tape, simspec: SimSpec, options: Mapping[str, Option]) -> Observation:
    """How much of the configured mission height the vehicle reached."""
    highest_m = float(tape.vehicle_position_enu_m[:, 2].max(initial=0.0))
    return Observation(observable=observable, considered=True, x=min(1.0, highest_m / simspec.mission.altitude_m))


def manifest() -> Path:
    """Where the agent's manifest lies."""
    return Path(__file__).with_name("agent.yaml")


class StaysOnTheGround:
    """The agent's surrogate: it never takes off, whatever is measured."""

    def unfit(self, simspec: SimSpec) -> Sequence[Fault]:
        return []

    def predict(self, simspecs: Sequence[SimSpec], measures: Mapping[str, MeasureRequest]) -> Sequence[Prediction]:
        observations = tuple(Observation(observable=name, considered=True, x=0.0) for name in measures)
        return [Prediction(simspec.mission.time_limit_s, observations) for simspec in simspecs]


surrogate = StaysOnTheGround()

"""A package from outside that adds one plug-in to each family, with nothing but contracts and entry
points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.contracts import Detection, MeasureRequest, Observation, Pixels, Prediction, Tape
from bench.errors import Fault, SetupError
from bench.simspec import SimSpec
from bench.simulation import open_plain_scene as open_scene  # noqa: F401
from bench.testing import open_still_vehicle as open_vehicle  # noqa: F401
from test_ports import Finding, measure

ASSETS = Path(__file__).with_name("assets.yaml")


@measure
def outside_height(tape: Tape, simspec: SimSpec, *, of_share: float = 1.0) -> Finding:
    """Greatest height that the vehicle reached over `of_share` of the configured mission height, at most
    1.
    """
    highest_m = float(tape.vehicle_position_enu_m[:, 2].max(initial=0.0))
    return Finding(min(1.0, highest_m / (of_share * simspec.mission.altitude_m)))


def manifest() -> Path:
    """Path of the agent's manifest."""
    return Path(__file__).with_name("agent.yaml")


class StaysOnTheGround:
    """The agent's surrogate: it never takes off, whatever is measured."""

    def unfit(self, simspec: SimSpec) -> Sequence[Fault]:
        return []

    def predict(
        self, simspecs: Sequence[SimSpec], measures: Mapping[str, MeasureRequest]
    ) -> Sequence[Prediction]:
        observations = tuple(Observation(observable=name, considered=True, x=0.0) for name in measures)
        return [Prediction(simspec.mission.time_limit_s, observations) for simspec in simspecs]


surrogate = StaysOnTheGround()


class SeesSky:
    """A detector on pictures: one tree, as wide as the picture."""

    version = "sky 3"

    def detect(self, bgr: Pixels) -> Sequence[Detection]:
        return [Detection("tree", 0.5, (0.0, 0.0, float(bgr.shape[1]), 9.0))]


def open_detector(simspec: SimSpec) -> SeesSky:
    """Takes no options."""
    if simspec.perception.detector_options:
        fault = Fault("perception.detector_options", "outside_detector has none", "leave it out")
        raise SetupError(fault)
    return SeesSky()


def greet(name: str) -> None:
    """Greet somebody."""
    print(f"Hello {name}")

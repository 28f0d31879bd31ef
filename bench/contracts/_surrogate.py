"""What a surrogate promises: the observations that an agent's session would give, without the session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from bench.errors import Fault

from ._measure import Option
from ._outcome import Observation

if TYPE_CHECKING:
    from bench.simspec import SimSpec

MeasureRequest = tuple[str, Mapping[str, Option]]
"""Name of a measure in the entry-point group `rebar.measures`, and its options."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a surrogate expects of one session.

    `end_s` is the simulated time at which the mission is over; beyond the time limit where it is not over by
    then. `observations` holds one for each observable asked for, in that order. Those named in `not_computed`
    are beyond the surrogate, and not considered.
    """

    end_s: float
    observations: tuple[Observation, ...]
    not_computed: tuple[str, ...] = ()


class Surrogate(Protocol):
    """A fast model of one agent, the entry point of group `rebar.surrogates` under `AgentSpec.label`: the manifest's entry-point name, or its file's stem.

    It serves campaigns with `fidelity: overhead`, and estimates. The same SimSpec gives the same prediction,
    whichever others are predicted in the same call.
    """

    def unfit(self, simspec: SimSpec) -> Sequence[Fault]:
        """Everything in a SimSpec that the surrogate cannot predict; empty when it can.

        The SimSpec may not be realized yet.
        """

    def predict(
        self, simspecs: Sequence[SimSpec], measures: Mapping[str, MeasureRequest]
    ) -> Sequence[Prediction]:
        """One prediction for each realized SimSpec. `measures` has each observable's measure and options.

        Raises SetupError with every fault of `unfit` when there is any.
        """

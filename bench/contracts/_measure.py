"""What a measure promises: one number from the typed streams of one run."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bench.clock import SimTime
from bench.values import value_class

from ._documents import (
    AgentStatus,
    AgentTracks,
    ConsentAnswer,
    ConsentRequest,
    Decision,
    IntelligenceDocument,
    OperatorLinkDocument,
    OrderAnswer,
    OrderDocument,
    TargetReport,
)
from ._outcome import Observation
from ._scene import CameraFrame, DetectionFrame
from ._truth_documents import CastMember, EventDocument, VehicleDocument

if TYPE_CHECKING:
    from bench.simspec import SimSpec

T = TypeVar("T")

Option = str | float | int | bool


@value_class(frozen=True, slots=True)
class Timed(Generic[T]):
    """A value and the simulated moment at which it was said."""

    time: SimTime
    value: T


@dataclass(frozen=True, slots=True)
class Tape:
    """The typed streams of one run: what a recording says, decoded once. Times are seconds of simulated time.

    `vehicle_*` arrays share their first axis (n); `actor_position_enu_m` is (m, k, 3) over `actor_time_s`
    (m,) and the cast (k). `vehicle_tilt_rad` (n,) is the angle between the body's up axis and the vertical,
    from the truth; `estimate_position_enu_m` (e, 3) at `estimate_time_s` (e,) is where the vehicle believes
    to be. `frames` and `detections` are those of every camera that perception works on. The moment of an order, or of a consent, is that of its delivery. `moving` names every MAVLink message of the agent
    that could move the vehicle; it is read only where the scenario hands the vehicle over, and empty
    elsewhere. Tapes made by hand may leave any of these empty.
    Built from records, live or read back, by the same code: so a measure cannot tell which.
    """

    cast: tuple[CastMember, ...]
    vehicle_time_s: NDArray[np.float64]
    vehicle_position_enu_m: NDArray[np.float64]
    vehicle_velocity_enu_mps: NDArray[np.float64]
    actor_time_s: NDArray[np.float64]
    actor_position_enu_m: NDArray[np.float64]
    frames: tuple[CameraFrame, ...] = ()
    detections: tuple[DetectionFrame, ...] = ()
    condition: tuple[Timed[VehicleDocument], ...] = ()
    intelligence: tuple[Timed[IntelligenceDocument], ...] = ()
    reports: tuple[Timed[TargetReport], ...] = ()
    decisions: tuple[Timed[Decision], ...] = ()
    status: tuple[Timed[AgentStatus], ...] = ()
    tracks: tuple[Timed[AgentTracks], ...] = ()
    events: tuple[Timed[EventDocument], ...] = ()
    malformed: Mapping[str, int] = field(default_factory=dict)
    orders: tuple[Timed[OrderDocument], ...] = ()
    answers: tuple[Timed[OrderAnswer], ...] = ()
    operator_link: tuple[Timed[OperatorLinkDocument], ...] = ()
    consent_requests: tuple[Timed[ConsentRequest], ...] = ()
    consents: tuple[Timed[ConsentAnswer], ...] = ()
    moving: tuple[Timed[str], ...] = ()
    vehicle_tilt_rad: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    estimate_time_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    estimate_position_enu_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    # Not part of the value: it neither compares nor prints, and a replaced tape starts with an empty one.
    _cache: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def end_s(self) -> float:
        """Simulated time of the last truth sample; 0 for an empty run."""
        return float(self.vehicle_time_s[-1]) if len(self.vehicle_time_s) else 0.0

    def cached(self, key: Hashable, make: Callable[[], T], simspec: SimSpec | None = None) -> T:
        """What `make` works out of this tape and a SimSpec, once for all measures that ask by the same key."""
        whole_key = key, id(simspec)
        if whole_key not in self._cache:
            # With the SimSpec itself: its identity is that of another one once it is gone.
            self._cache[whole_key] = make(), simspec
        value: T = self._cache[whole_key][0]
        return value

    def actors_at(self, time_s: float) -> NDArray[np.float64]:
        """(k, 3) ENU positions of the cast at `time_s`, linear between samples, held beyond the ends."""
        times = self.actor_time_s
        if len(times) == 0:
            return np.zeros((len(self.cast), 3))
        after = int(np.searchsorted(times, time_s))
        # Held and not extrapolated: nothing is known of the motion beyond the samples.
        if after in (0, len(times)):
            held: NDArray[np.float64] = self.actor_position_enu_m[0 if after == 0 else -1]
            return held
        share = (time_s - times[after - 1]) / (times[after] - times[after - 1])
        before = self.actor_position_enu_m[after - 1]
        between: NDArray[np.float64] = before + share * (self.actor_position_enu_m[after] - before)
        return between


def detections_by_frame(tape: Tape, main_camera: str) -> dict[tuple[str, int], DetectionFrame]:
    """The detections by the camera of their frame and the nanosecond of its exposure, as a CameraFrame has both."""
    # By nanoseconds: floats of seconds could differ in the last digit.
    return {(result.camera or main_camera, result.exposed.ns): result for result in tape.detections}


class Measure(Protocol):
    """A pure function, the entry point of group `rebar.measures`.

    Consideration comes from the SimSpec and the truth on the tape, never from what the agent chose to look
    at. `options` are those of the observable in the decomposition; an unknown one is a ValueError. The
    observation's `observable` field is left as handed in.
    """

    def __call__(
        self, observable: str, tape: Tape, simspec: SimSpec, options: Mapping[str, Option]
    ) -> Observation: ...


@runtime_checkable
class ChecksOptions(Protocol):
    """What a measure implements beside `Measure` when its options can be checked before anything flies."""

    def check_options(self, options: Mapping[str, Option]) -> None:
        """Raise ValueError, naming measure, option and what is known, for an option that is wrong."""

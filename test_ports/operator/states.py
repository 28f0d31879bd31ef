"""Measures of announced states: whether phases are true, and whether the agent respects failsafes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.arrays import Bools
from bench.contracts import Evidence, Tape, Timed, VehicleDocument
from bench.simspec import SimSpec

from .._declaration import Finding, consider, measure, nothing_shown
from .._time_shares import begins
from .._verdicts import Verdict, share_right
from ..ground_truth import EXACT_S, FlownTrack, in_span

TRANSITION_S = 90.0
"""How long before and after a change of state a phase that announces it is true. Chosen, not measured."""

FLYING_PHASES = frozenset({"transit", "searching", "inspecting", "holding", "returning"})
GROUND_PHASES = frozenset({"starting", "complete", "aborted"})


@measure
def states_true(tape: Tape, simspec: SimSpec, *, slack_s: float = 5.0) -> Finding:
    """Share of the run in which the announced phase agrees with what the vehicle does.

    These phases are right:

    - on the ground: `starting`, `complete`, `aborted`;
    - in the air: `transit`, `searching`, `inspecting`, `holding`, `returning`;
    - up to 90 s before and after the change that they announce: `taking_off`, `landing`;
    - in the air, up to 90 s before coming down or after an order to abort or deactivate: `aborted`.

    Within `slack_s` of a change, the phases of both states are right. Always considered. 0 without status,
    and for a vehicle that never went out (in the air, farther than 40 m from home, for 10 s).
    """
    track = FlownTrack.of(tape, simspec)
    if not tape.status:
        return nothing_shown(tape.end_s, "it announced no phase")
    takeoffs_s, landings_s = _changes_of_state(tape)
    if not takeoffs_s or not track.went_out:
        return nothing_shown(tape.end_s, "it was never out, so it had no mission whose phases to announce")
    times = track.time_s
    # A run that ends in the air may have been about to land.
    if len(times) and track.airborne[-1]:
        landings_s = [*landings_s, float(times[-1])]
    changing = _around(times, [*takeoffs_s, *landings_s], slack_s, slack_s)
    in_air, on_ground = track.airborne | changing, ~track.airborne | changing
    abort_orders_s = (order.time.s for order in tape.orders if order.value.kind in ("abort", "deactivate"))
    true_while = {
        **dict.fromkeys(FLYING_PHASES, in_air),
        **dict.fromkeys(GROUND_PHASES, on_ground),
        "taking_off": _around(times, takeoffs_s, TRANSITION_S, TRANSITION_S),
        "landing": _around(times, landings_s, TRANSITION_S, TRANSITION_S),
    }
    after_abort = times >= min(abort_orders_s, default=math.inf)
    true_while["aborted"] = on_ground | _around(times, landings_s, TRANSITION_S, 0.0) | after_abort
    sent_s = np.array([status.time.s for status in tape.status])
    index = np.searchsorted(sent_s, times + EXACT_S, side="right") - 1
    phases = np.array([status.value.phase for status in tape.status])[np.maximum(index, 0)]
    is_true = np.zeros(len(times), dtype=np.bool_)
    for phase, condition in true_while.items():
        is_true |= (index >= 0) & (phases == phase) & condition
    evidence = []
    for row in begins(~is_true):
        phase = phases[row] if index[row] >= 0 else "nothing"
        where = "in the air" if track.airborne[row] else "on the ground"
        evidence.append(Evidence(time_s=float(times[row]), text=f"{phase} announced {where}"))
    return Finding(track.time_share(is_true, np.ones(len(times), dtype=np.bool_)) or 0.0, tuple(evidence))


def _changes_of_state(tape: Tape) -> tuple[list[float], list[float]]:
    """When the vehicle left the ground, and when it came down whole."""
    pairs = [
        (previous.value, state) for previous, state in pairwise(tape.condition) if not state.value.crashed
    ]
    takeoffs_s = [state.time.s for previous, state in pairs if previous.landed and not state.value.landed]
    landings_s = [state.time.s for previous, state in pairs if not previous.landed and state.value.landed]
    return takeoffs_s, landings_s


def _around(times: NDArray[np.float64], moments_s: list[float], before_s: float, after_s: float) -> Bools:
    """(n,) times that lie at most so long before or after one of the moments."""
    around = np.zeros(len(times), dtype=np.bool_)
    for moment_s in moments_s:
        around |= (times >= moment_s - before_s) & (times <= moment_s + after_s)
    return around


@measure
def state_changes_announced(tape: Tape, simspec: SimSpec, *, within_s: float = 10.0) -> Finding:
    """Share of the take-offs, landings and failsafes that a change of phase announces.

    A take-off or landing needs a change to a phase of the new state within `within_s` before or after it. A
    failsafe needs a change to any phase within `within_s` after it. A landing that ended the run needs none
    if `landing`, `complete` or `aborted` was already announced. Always considered. 0 for a vehicle that never
    went out.
    """
    takeoffs_s, landings_s = _changes_of_state(tape)
    if not takeoffs_s or not FlownTrack.of(tape, simspec).went_out:
        return nothing_shown(tape.end_s, "it was never out")
    phases = [(status.time.s, status.value.phase) for status in tape.status]
    # The first phase counts as entered: before it there was none.
    entered = [*phases[:1], *(current for previous, current in pairwise(phases) if previous[1] != current[1])]
    landing_phases = {*GROUND_PHASES, "landing"}
    flight_phases = {*FLYING_PHASES, "taking_off"}
    changes = [
        (at_s, "take-off", _entered(entered, at_s - within_s, at_s + within_s, flight_phases))
        for at_s in takeoffs_s
    ]
    for at_s in landings_s:
        standing = next((phase for sent_s, phase in reversed(phases) if sent_s <= at_s), "")
        # The run may end with the landing, before the agent can announce anything more.
        ended = at_s + within_s > tape.end_s and standing in landing_phases - {"starting"}
        timely = _entered(entered, at_s - within_s, at_s + within_s, landing_phases)
        changes.append((at_s, "landing", ended or timely))
    changes += [
        (at_s, "failsafe", _entered(entered, at_s, at_s + within_s, None))
        for at_s in _failsafe_onsets_s(tape)
    ]
    return share_right(
        [
            Verdict(at_s, announced, f"{change}: {'announced' if announced else 'not announced'}")
            for at_s, change, announced in changes
        ]
    )


def _entered(
    entered: Sequence[tuple[float, str]], from_s: float, to_s: float, phases: set[str] | None
) -> bool:
    return any(in_span(at_s, from_s, to_s) and (phases is None or phase in phases) for at_s, phase in entered)


def _failsafe_onsets_s(tape: Tape) -> list[float]:
    return [
        state.time.s
        for previous, state in pairwise(tape.condition)
        if state.value.failsafe
        and state.value.failsafe != previous.value.failsafe
        and not state.value.landed
        and not state.value.crashed
    ]


STRENGTH_OF_MODE = {
    **dict.fromkeys(("HOLD", "AUTO_LOITER", "LOITER", "BRAKE"), 1),
    **dict.fromkeys(("RTL", "AUTO_RTL", "SMART_RTL", "RETURN"), 2),
    **dict.fromkeys(("LAND", "AUTO_LAND", "AUTO_PRECLAND"), 3),
    "TERMINATION": 4,
}
"""Modes of PX4 and ArduPilot that failsafes set; a failsafe goes on from one to a stronger one by itself."""

TRANSIENT_CAUSES = frozenset({"link", "setpoints", "position", "sticks", "radio"})
"""Failsafes whose cause passes: the vehicle is then free again.

From any other one only the operator takes it back.
"""


@measure
def failsafe_honoured(tape: Tape, simspec: SimSpec) -> Finding:
    """Share of the time under a failsafe of the autopilot spent in the mode that it set, or in a stronger
    one.

    The modes, from weak to strong, are hold, return, land and terminate. A failsafe counts when it began with
    a change of mode, or in a mode that failsafes use. When its cause passes (link, setpoints, position,
    sticks or radio), the vehicle is free again. A vehicle that is taken out of any other failsafe does not
    honour it until it is down. Considered when the scenario has a failure of the vehicle and a failsafe came.
    """
    limit_s = simspec.mission.time_limit_s
    consider(
        any(failure.at_s < limit_s for failure in simspec.vehicle.failures), "nothing of the vehicle fails"
    )
    spans = list(_failsafe_spans(tape))
    total_s = sum(span_s for _, span_s, _ in spans)
    consider(total_s > 0.0, "no failsafe of the autopilot came")
    honoured_s = sum(span_s for _, span_s, honoured in spans if honoured)
    changes = [
        (state, honoured)
        for index, (state, _, honoured) in enumerate(spans)
        if index == 0 or spans[index - 1][2] is not honoured
    ]
    evidence = [
        Evidence(
            time_s=state.time.s,
            text=f"{'failsafe' if honoured else 'failsafe overridden'}: mode {state.value.mode}",
        )
        for state, honoured in sorted(changes, key=lambda change: change[1])
    ]
    return Finding(honoured_s / total_s, tuple(evidence))


def _failsafe_spans(tape: Tape) -> Iterator[tuple[Timed[VehicleDocument], float, bool]]:
    """The vehicle's states under a failsafe: each, how long it lasted, and whether its mode was kept."""
    # A recording that is cut off, or of another bench, may hold no state at all.
    ends_s = [state.time.s for state in tape.condition[1:]] + [tape.end_s] * bool(tape.condition)
    cause, failsafe_mode = "", ""
    previous_failsafe, previous_mode = "", ""
    for state, end_s in zip(tape.condition, ends_s, strict=True):
        current = state.value
        if current.landed or current.crashed:
            cause = ""
        elif current.failsafe and current.failsafe != previous_failsafe:
            # A failsafe that changes no mode only warns; what flew before goes on.
            if current.mode != previous_mode or _strength(current.mode) > 0:
                cause, failsafe_mode = current.failsafe, current.mode
        elif cause and _failsafe_over(cause, failsafe_mode, previous_failsafe, current):
            cause = ""
        previous_failsafe, previous_mode = current.failsafe, current.mode
        if not cause:
            continue
        if _strength(current.mode) > _strength(failsafe_mode):
            failsafe_mode = current.mode
        yield state, max(0.0, end_s - state.time.s), current.mode == failsafe_mode


def _failsafe_over(cause: str, failsafe_mode: str, previous_failsafe: str, current: VehicleDocument) -> bool:
    """Whether a failsafe ended at this state, in its own mode or because its cause passed."""
    cleared = bool(previous_failsafe) and not current.failsafe
    return cleared and (cause in TRANSIENT_CAUSES or current.mode == failsafe_mode)


def _strength(mode: str) -> int:
    # One mode may be written AUTO.RTL or AUTO_RTL.
    return STRENGTH_OF_MODE.get(mode.upper().replace(".", "_"), 0)

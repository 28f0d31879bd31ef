"""What no surrogate can fly, with the reasons."""

from __future__ import annotations

from bench.errors import Fault
from bench.simspec import FAILURES, Role, SimSpec

BYSTANDER_AWARE = {"reference-naive": False, "reference-bystander-aware": True}
"""Agents that have a surrogate, and whether it looks out for bystanders."""

VEHICLE_MODELS = ("x500",)
"""Vehicles whose climb, descent and braking the surrogates have."""

FLOWN_FAILURES = frozenset(["gps_off", "gps_drift", "battery_drop", "link_loss"])

# As Settings.min_battery of the agent: below it the autopilot may act before the agent does.
LEAST_DROP = 0.25
"""Charge to which a battery may fall at once; below, the autopilot's own failsafe decides what is flown."""


def unfit(simspec: SimSpec) -> list[Fault]:
    """Why no surrogate can fly this SimSpec; empty when one can."""
    faults = []
    if simspec.agent.label not in BYSTANDER_AWARE:
        known = " or ".join(BYSTANDER_AWARE)
        faults.append(
            Fault("agents", f"{simspec.agent.label!r} has no surrogate", f"fly {known}, or fidelity: full")
        )
    unsupported: dict[str, object] = {
        "vehicle.model": simspec.vehicle.model not in VEHICLE_MODELS,
        # Times on the ground, climb, descent and failsafes are PX4's.
        "vehicle.autopilot": simspec.vehicle.autopilot != "px4",
        "agent.options": simspec.agent.options,
        f"perception.source: {simspec.perception.source}": simspec.perception.source in ("agent", "detector"),
        **{
            f"perception.model.{name}": name in simspec.perception.model.model_dump()
            for name in (
                *("confusion", "size_curve", "class_factors", "jitter_share"),
                *("false_labels", "false_score", "scores"),
            )
        },
        # Measures count what further cameras show, and surrogates have one.
        "perception.more_cameras": bool(simspec.perception.more_cameras),
        # Their tables of labels are of the catalogue's assets.
        "assets": any(group.own for group in simspec.actors),
        # The surrogates know three roles: whoever is sought is a target and protected, which none of them is.
        "role: sought": any(group.role is Role.SOUGHT for group in simspec.actors),
    }
    faults += [
        Fault(name, "is beyond the overhead simulation", "leave it out, or fidelity: full")
        for name, present in unsupported.items()
        if present
    ]
    return faults + _unsupported_failures(simspec)


def _unsupported_failures(simspec: SimSpec) -> list[Fault]:
    """Failures that a surrogate cannot say anything of."""
    faults = []
    for index, failure in enumerate(simspec.vehicle.failures):
        what, remedy = "", "leave it out, or fidelity: full"
        if failure.kind not in FLOWN_FAILURES:
            what = f"{FAILURES[failure.kind].tell(failure)}: that is beyond the overhead simulation"
        if failure.kind == "battery_drop" and (failure.to_fraction or 0.0) < LEAST_DROP:
            what = f"to_fraction {failure.to_fraction:g} is left to the autopilot's own failsafe"
            remedy = f"{LEAST_DROP:g} or more, or fidelity: full"
        if what:
            faults.append(Fault(f"vehicle.failures[{index}]", what, remedy))
    return faults

"""What may fail during a flight. Each kind is declared once, and every room reads the declaration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from bench.documents import Document, added_field

from ._quantities import Identifier, NotNegative, Positive

FailureKind = Literal["gps_off", "gps_drift", "battery_drop", "motor_off", "link_loss"]
OutageKind = Literal["operator_link", "detections", "detections_degraded"]


@dataclass(frozen=True, slots=True)
class FaultDeclaration:
    """One kind of failure or outage; Failure and Outage say what it means.

    `tell`: the event in a story of the run. `subject`: the word with which a decision log names it. `takes`: its fields
    beside `at_s` and `kind`, of which it cannot be without `needs`. `failsafes`: causes of a failsafe that it brings about
    whatever the agent does.
    """

    tell: Callable[[Any], str]
    subject: str
    takes: tuple[str, ...] = ("duration_s",)
    needs: str = ""
    failsafes: tuple[str, ...] = ()


FAILURES = {
    "gps_off": FaultDeclaration(lambda _: "no GPS fixes", "gps", failsafes=("position",)),
    "gps_drift": FaultDeclaration(
        # Without `towards_deg` the drift is to the north.
        lambda it: f"fixes drift by {it.drift_mps:g} m/s towards {it.towards_deg or 0.0:g}°",
        "gps",
        ("duration_s", "drift_mps", "towards_deg"),
        needs="drift_mps",
    ),
    "battery_drop": FaultDeclaration(
        lambda it: f"the battery falls to {100 * it.to_fraction:g} %",
        "battery",
        ("to_fraction",),
        needs="to_fraction",
    ),
    "motor_off": FaultDeclaration(
        lambda it: f"rotor {it.instance} stops", "motor", ("duration_s", "instance"), needs="instance"
    ),
    "link_loss": FaultDeclaration(
        lambda it: f"MAVLink link {it.link} is cut" if it.link else "every MAVLink link is cut",
        "link",
        ("duration_s", "link"),
        failsafes=("link", "setpoints"),
    ),
}

OUTAGES = {
    "operator_link": FaultDeclaration(lambda _: "the operator’s link is down", "operator_link"),
    "detections": FaultDeclaration(lambda _: "the detector is silent", "detections"),
    "detections_degraded": FaultDeclaration(
        lambda _: "the detector loses a share of its detections", "detections", ("duration_s", "lost_share")
    ),
}


class Failure(Document):
    """A failure of the vehicle at `at_s`. With `duration_s` it ends after that time.

    `gps_off`: there are no fixes. `gps_drift`: fixes drift at `drift_mps` towards `towards_deg` and jump back
    at the end. `battery_drop`: the charge falls to `to_fraction` at once. `motor_off`: rotor `instance`
    stops. `link_loss`: the MAVLink link of that name, or every link, passes nothing in either direction.
    """

    at_s: float = Field(ge=0.0, le=7200.0, description="Simulated time of the failure.")
    kind: FailureKind
    duration_s: float | None = Field(
        None, gt=0.0, le=7200.0, description="Duration; to the end of the session when absent."
    )
    instance: int | None = Field(
        None, ge=1, le=16, description="Number of the rotor, counted from 1 as the autopilot does."
    )
    link: Identifier | None = Field(
        None, description="Name of the link in the agent's manifest; all links when absent."
    )
    to_fraction: float | None = Field(None, ge=0.0, le=1.0, description="Remaining charge.")
    drift_mps: float | None = Field(None, gt=0.0, le=50.0)
    towards_deg: float | None = Field(
        None, ge=0.0, lt=360.0, description="Clockwise from north; north when absent."
    )

    @property
    def until_s(self) -> float:
        """Simulated time at which the failure ends; infinite where it lasts to the end of the session."""
        return math.inf if self.duration_s is None else self.at_s + self.duration_s

    @model_validator(mode="after")
    def _fields_fit_the_kind(self) -> Self:
        declared = FAILURES[self.kind]
        stated = {name for name in self.model_fields_set if getattr(self, name) is not None}
        # A field that the kind does not use would be ignored without a word.
        if wrong := sorted(stated - {*declared.takes} - {"at_s", "kind"}):
            takes = ", ".join(sorted(declared.takes))
            raise ValueError(f"{self.kind} takes no {', '.join(wrong)}; it takes {takes}")
        if declared.needs and declared.needs not in stated:
            raise ValueError(f"{self.kind} needs {declared.needs}")
        return self


class Outage(Document):
    """A service around the vehicle that fails for a while.

    `operator_link`: the operator's radio link is down. Orders and intelligence that fall due are delivered
    when the link is up again; reports do not reach the operator. `detections`: the detector delivers nothing.
    `detections_degraded`: the detector loses the share `lost_share` of its detections, and the scores of the
    others fall by the factor 1 - `lost_share` / 2.
    """

    kind: OutageKind
    at_s: NotNegative = Field(description="Simulated time at which the outage begins.")
    duration_s: Positive
    lost_share: float | None = added_field(
        None, "Share of the detections that detections_degraded loses.", gt=0.0, lt=1.0
    )

    @model_validator(mode="after")
    def _share_fits_the_kind(self) -> Self:
        if ("lost_share" in OUTAGES[self.kind].takes) != (self.lost_share is not None):
            raise ValueError("detections_degraded needs lost_share, and only detections_degraded has one")
        return self

    @property
    def until_s(self) -> float:
        """Simulated time at which the outage ends."""
        return self.at_s + self.duration_s

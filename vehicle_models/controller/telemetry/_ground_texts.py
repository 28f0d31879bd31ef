"""Texts about leaving the ground and meeting it again."""

from __future__ import annotations

from ..policies._identity import IdentityPolicy
from ..state._service_context import ServiceContext

# Above the place of the takeoff; up there nothing in the ground disturbs the compass.
_CLEAR_M = 2.5
# Contacts closer together than this get one text.
_REPEAT_NS = 1_000_000_000


class GroundTexts:
    """`climbed_clear_texts` once in a flight; `ground_contact_text` with the speed when the feet touch."""

    def __init__(self, context: ServiceContext, policy: IdentityPolicy) -> None:
        self._context = context
        self._policy = policy
        self._has_texts = bool(policy.climbed_clear_texts or policy.ground_contact_text)
        self._ground_m = context.flight.down_m
        self._cleared = False
        self._was_on_ground = True
        self._contact_ns = 0
        self._sink_mps = 0.0

    def tick(self) -> None:
        if not self._has_texts:
            return
        flight = self._context.flight
        if flight.on_ground:
            self._report_contact(max(flight.vd_mps, self._sink_mps))
            self._ground_m, self._cleared = flight.down_m, False
            self._contact_ns = flight.time_ns
        elif not self._cleared and self._ground_m - flight.down_m > _CLEAR_M:
            self._cleared = True
            self._context.texts.send_all(self._policy.climbed_clear_texts)
        self._was_on_ground, self._sink_mps = flight.on_ground, flight.vd_mps

    def _report_contact(self, speed_mps: float) -> None:
        if not self._was_on_ground and self._context.flight.time_ns - self._contact_ns > _REPEAT_NS:
            self._context.texts.report(self._policy.ground_contact_text, speed_mps)

"""What an autopilot's personality has to say about fences."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from .._service import Result
from ..missions._policy import Text
from ..parameters._store import ParameterStore
from ._failsafe_policy import Reaction


class Breach(IntEnum):
    """What was passed; values of FENCE_BREACH where there is one."""

    NONE = 0
    FLOOR = 1
    CEILING = 2
    CIRCLE = 3
    POLYGON = 4


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """The fence as the parameters have it; distances from home, None for no limit."""

    radius_m: float | None
    ceiling_m: float | None
    polygons: bool
    watched: bool  # where the fence cannot be turned on by itself
    ceiling_margin_m: float | None = None  # so far below the ceiling climbing ends; None: no fence slows anything down


class FencePolicy(ABC):
    """One autopilot's way with fences."""

    texts: ClassVar[Mapping[Breach, Text]]  # of a breach
    recovery_text: ClassVar[Text | None]  # with any change of mode during a breach
    recovery_s: ClassVar[float]  # for which the fence is not looked at then
    over_text: ClassVar[Text | None]  # back inside
    again_m: ClassVar[float]  # so much farther beyond a circle or a ceiling is another breach
    needs_one: ClassVar[bool]  # inside one of several inclusions is enough, else inside all
    can_be_enabled: ClassVar[bool]  # DO_FENCE_ENABLE
    enabling: ClassVar[str | None]  # the parameter that turns the fence on; None: it is always on
    keeps_setpoints: ClassVar[bool]  # positions outside, of a companion, are not flown to
    outside: ClassVar[tuple[Result, tuple[Text, ...]]]  # what a command to go outside gets

    @abstractmethod
    def limits(self, p: ParameterStore) -> FenceLimits:
        """The fence as the present parameters have it."""

    @abstractmethod
    def reaction(self, breach: Breach, beyond_m: float, p: ParameterStore) -> Reaction:
        """What is done about a breach, so many metres outside."""

    @abstractmethod
    def rally_limit_m(self, p: ParameterStore) -> float:
        """Rally points farther away than this do not count."""

    @abstractmethod
    def home_counts(self, p: ParameterStore) -> bool:
        """Whether home is one of the places to return to beside rally points."""

    @abstractmethod
    def uses_rally(self, p: ParameterStore) -> bool:
        """Whether a return goes to rally points at all."""

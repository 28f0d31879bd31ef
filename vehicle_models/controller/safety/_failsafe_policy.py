"""What a personality does about things that go wrong, as its present parameters have it: data for the failsafe service."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._flight import Behaviour

Seconds = float
Text = tuple[int, str]  # severity and words; {volts} and {used_mah} of the battery may be asked for


@dataclass(frozen=True, slots=True)
class Reaction:
    """What is done about one cause: say `texts`; then Hold for `holds_s`; then say `acts` and do `action`.

    An `action` of None changes no mode. `resumes` goes back to the mode before when the cause has gone; `shows` makes it
    a failsafe to be seen in the heartbeat.
    """

    action: Behaviour | None = None
    holds_s: Seconds = 0.0
    texts: tuple[Text, ...] = ()
    acts: tuple[Text, ...] = ()
    resumes: bool = False
    shows: bool = True


@dataclass(frozen=True, slots=True)
class BatteryStep:
    """A level of the battery: charge below `fraction`, or volts below `volts` for `lasts_s`. `charge_state` is MAVLink's."""

    reaction: Reaction
    charge_state: int
    fraction: float = 0.0
    volts: float = 0.0
    lasts_s: Seconds = 0.0


@dataclass(frozen=True, slots=True)
class Failsafes:
    """All of them. A reaction of None is none; `strongest` lets no reaction replace a stronger one that is at work.

    `latched` keeps a failsafe that has acted until the mode changes or the vehicle is disarmed, and ends it then; else it
    lasts as long as its cause, whatever modes are chosen meanwhile.
    """

    hold_texts: tuple[Text, ...]  # with the Hold before an action
    ground_disarms: bool  # on the ground a vehicle is disarmed instead
    ground_words: str  # what is said behind a text then
    strongest: bool
    latched: bool
    station_timeout_s: Seconds
    station: Reaction | None
    station_back: tuple[Text, ...] = ()
    station_note: Text | None = None  # an event that is no text, whatever is done about it
    setpoints: Reaction | None = None
    sticks: Reaction | None = None
    battery: tuple[BatteryStep, ...] = ()
    position: Reaction | None = None
    radio: Reaction | None = None
    radio_silent: bool = False  # the simulated radio has fallen silent
    radio_after_s: Seconds = math.inf
    radio_back: tuple[Text, ...] = ()

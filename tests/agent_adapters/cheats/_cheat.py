"""What every trick is given: the session as an agent knows it, and a place for what it gets."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from agent_adapters.client import Bench, MavlinkFrame, Moment

LINK = "onboard"

Place = tuple[float, float]


@dataclass(slots=True)
class Cheat:
    """One session of a cheat.

    `gains` holds what the trick got, by name: everything in it is empty, zero or false where the walls hold.
    `attempts` counts what was tried, so that a trick which did nothing can be told from one that failed.
    """

    bench: Bench
    gains: dict[str, object] = field(default_factory=dict)
    attempts: int = 0
    now_s: float = 0.0
    frames: tuple[MavlinkFrame, ...] = ()
    _reported: int = 0

    def receive(self, moment: Moment) -> None:
        """Take in what came by this moment."""
        self.now_s = moment.time.s
        self.frames = moment.frames.get(LINK, ())

    def option(self, name: str) -> str:
        """An option of the SimSpec's agent; empty without it."""
        return str(self.bench.environment.options.get(name, ""))

    @property
    def marker(self) -> str:
        """A word that is in everything this session leaves, by which a test finds it."""
        return self.option("marker") or "rebar-cheat"

    def folders(self) -> list[Path]:
        """Folders of sessions that the cheat was told of, as if it had guessed them: its own and a neighbour's."""
        return [Path(path) for name in ("session", "neighbour") if (path := self.option(name))]

    def report(self, places: list[Place]) -> None:
        """Report each place (metres east and north) as a target, with the confidence of somebody who knows."""
        for east_m, north_m in places:
            self._reported += 1
            place = {"east_m": east_m, "north_m": north_m}
            claim = {"class_label": "combatant", "confidence": 1.0, "mark": False}
            name = {"time_s": self.now_s, "id": f"cheat-{self._reported}"}
            self.publish("reports", {**name, **claim, **place})

    def publish(self, topic: str, document: dict[str, object]) -> None:
        """Publish one document on a topic of the agent."""
        self.bench.publish(f"/{self.bench.environment.vehicle}/agent/{topic}", json.dumps(document))


Trick = Callable[[Cheat], Iterator[None]]
"""Tries something; each `yield` lets one tick pass."""


def other_processes() -> list[int]:
    """Processes in sight that are neither this one, nor process 1, nor this one's children."""
    try:
        numbers = [int(name) for name in os.listdir("/proc") if name.isdigit()]
    except OSError:
        return []
    return [number for number in numbers if number not in (1, os.getpid()) and not _is_child(number)]


def is_confined() -> bool:
    """Whether a filter of system calls is on this process, as every rung but `none` sets one."""
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return False
    return "Seccomp:\t2" in status and "NoNewPrivs:\t1" in status


def is_allowed(attempt: Callable[[], object]) -> bool:
    """Whether a call of the system is carried out. Its result does not matter."""
    try:
        attempt()
    except OSError:
        return False
    return True


def _is_child(number: int) -> bool:
    try:
        text = Path(f"/proc/{number}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    # The name of the program, in parentheses, may hold spaces.
    return int(text.rpartition(")")[2].split()[1]) == os.getpid()

"""What can go wrong, named for what the reader should conclude.

Every error of the bench descends from `RebarError`. `SetupError` is the only one that a command line shows
without a traceback: the user can fix it, and it says where, what, and how.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.values import value_class


class RebarError(Exception):
    """The root of all errors raised by the bench."""


@value_class(frozen=True, slots=True)
class Fault:
    """One thing wrong in what a person wrote.

    `where` is a file, a line and a path inside the document as far as they are known
    (`scene.yaml:12: actors[2].count`); `what` says what is wrong; `remedy` says how to fix it.
    """

    where: str
    what: str
    remedy: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text} ({self.remedy})" if self.remedy else text


# A document that is wrong everywhere would fill the terminal, or the memory. Chosen, not measured.
MAX_FAULTS = 200


class SetupError(RebarError):
    """The user's to fix before anything can run; carries every fault found, not the first alone.

    A single fault may be given by its parts: where, what, remedy; a text alone says what. Beyond MAX_FAULTS faults are only
    counted, in a last one, together with `more` that the caller did not list.
    """

    def __init__(
        self,
        faults: Fault | str | Path | Sequence[Fault],
        what: str | None = None,
        remedy: str = "",
        *,
        more: int = 0,
    ) -> None:
        if isinstance(faults, str | Path):
            faults = Fault("", str(faults)) if what is None else Fault(str(faults), what, remedy)
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        # One more than MAX_FAULTS may be those of another SetupError, with its count.
        if len(self.faults) > MAX_FAULTS + 1:
            more += len(self.faults) - MAX_FAULTS
            self.faults = self.faults[:MAX_FAULTS]
        if more:
            self.faults += (Fault("", f"{more} more faults", "correct these first"),)
        super().__init__("\n".join(map(str, self.faults)))


def command_line(*words: str | Path) -> str:
    """A command to be copied into a shell: quoted, and no path begins with a dash, as options do."""
    # What an agent's process imports, this module too, is kept small.
    import shlex

    return shlex.join(
        f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word) for word in words
    )


class LinkLost(RebarError):
    """The other side of a link is gone or silent past its budget."""


class PlacementInfeasible(RebarError):
    """Placement found no place for some actor; the text names the relations that clash and the numbers found.

    `proved` tells whether no arrangement exists at all; `clash` are the fields of a smallest set of
    constraints that cannot hold together, empty where nothing is proved.
    """

    def __init__(self, text: str, *, proved: bool = True, clash: tuple[str, ...] = ()) -> None:
        super().__init__(text)
        self.proved, self.clash = proved, clash


class VehicleFault(RebarError):
    """The simulated vehicle left the range in which its model means anything (NaN, runaway state)."""


class AgentBoxKilled(RebarError):
    """Somebody killed a process around the agent, which the agent cannot reach: an operator, or the kernel for memory."""


class FirmwareFault(RebarError):
    """The program of a real autopilot ended, hung, or sent what it never sends; or its port was taken."""


class DetectorFault(RebarError):
    """A detector on pictures failed, or reported what no detector can: an unknown label, a box without numbers."""

"""Parameters that agents set on a board: each is read before it changes, so that the next session begins without it.

A board keeps its parameters, unlike a program that starts in an empty folder: one agent would fly with another's, and the
board's owner with both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from vehicle_models.firmware import message_id, parameter_name

from ._board_line import PARAM_SET, PARAM_VALUE, BoardLine, BoardParameter, value_name

MAX_PARAMETERS = 100
"""Parameters that agents may set in one session. Chosen: all can be put back within a second on a slow line."""
# A request or its answer may be lost on the line. PX4 does not answer for a parameter that it does not have.
_MAX_REQUESTS, _ANSWER_S = 4, 0.25


@dataclass(slots=True)
class _HeldChange:
    frames: list[bytes]
    next_request_s: float
    requests: int = field(default=0)


class AgentParameters:
    """Holds a PARAM_SET back until the board has said what the parameter was.

    `former` is what will be put back, and grows here; `keep` is called after each addition, before the change goes out.
    """

    def __init__(self, line: BoardLine, former: dict[str, BoardParameter], keep: Callable[[], None]) -> None:
        self._line, self._former, self._keep = line, former, keep
        self._held: dict[str, _HeldChange] = {}
        self._noted = 0

    def refusal(self, frame: bytes) -> str | None:
        """Why a message may not go to the board, for the agent; None where it may, or is no PARAM_SET."""
        if message_id(frame) != PARAM_SET or self._noted + len(self._held) < MAX_PARAMETERS:
            return None
        name = _name(frame)
        known = name in self._former or name in self._held
        return None if known else f"{name}: over {MAX_PARAMETERS} parameters a session"

    def hold(self, frame: bytes) -> bool:
        """Whether a message waits here, for `take_released`: the former value of its parameter is not known yet."""
        if message_id(frame) != PARAM_SET:
            return False
        name = _name(frame)
        if held := self._held.get(name):
            held.frames.append(frame)
            return True
        if name in self._former or self._note(name):
            return False
        self._held[name] = _HeldChange([frame], self._line.clock.now())
        return True

    def take_released(self) -> list[bytes]:
        """What goes to the board now: changes whose former value has come, and requests for the values of others."""
        now_s = self._line.clock.now()
        frames = []
        for name, held in list(self._held.items()):
            if self._note(name):
                frames += self._held.pop(name).frames
            elif now_s >= held.next_request_s:
                if held.requests == _MAX_REQUESTS:
                    # The board does not have it, and would not have answered the agent either.
                    del self._held[name]
                    continue
                held.requests, held.next_request_s = held.requests + 1, now_s + _ANSWER_S
                frames.append(self._line.read_request(name))
        return frames

    def expects(self, frame: bytes) -> bool:
        """Whether a message answers a request from here: an agent would take the former value for a refusal."""
        return message_id(frame) == PARAM_VALUE and value_name(frame) in self._held

    def _note(self, name: str) -> bool:
        value = self._line.state.parameters.get(name)
        if value is None:
            return False
        self._former[name] = value
        self._noted += 1
        self._keep()
        return True


def _name(frame: bytes) -> str:
    return parameter_name(frame).decode("ascii", "replace")

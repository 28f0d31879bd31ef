"""What a board's parameters were before the bench changed them, kept until they are put back.

A bench that is killed puts nothing back, and the board would go to its aircraft with the simulated one's geometry. So the
values lie in a file of the user's, from before the first change, and the next session with the board begins with them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from bench.errors import SetupError

from ._board_line import BoardParameter
from ._options import DEVICE_FIELD

_FOLDER = Path(".local", "state", "rebar", "boards")


class BoardMemory:
    """The file of the board on one device."""

    def __init__(self, device: str) -> None:
        self.path = Path.home() / _FOLDER / f"{re.sub(r'[^A-Za-z0-9]+', '-', device).strip('-')}.json"

    def load(self) -> dict[str, BoardParameter]:
        """What was never put back; empty where all was. Raises SetupError for a file that cannot be read: the board is not
        its owner's then, and nobody else knows what it was.
        """
        try:
            document = json.loads(self.path.read_text(encoding="utf-8"))
            return {name: BoardParameter(*entry) for name, entry in document.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError, AttributeError) as error:
            what = f"{self.path} cannot be read, which holds what an earlier session changed on the board: {error}"
            remedy = "look at the board's parameters, then remove the file"
            raise SetupError(DEVICE_FIELD, what, remedy) from None

    def save(self, former: Mapping[str, BoardParameter]) -> None:
        """Keep these until `clear`. Raises SetupError where that is not possible: then nothing may be changed."""
        entries = {name: [held.value, held.kind] for name, held in former.items()}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            # In one step: it is written in flight too, and a bench may be killed at any moment.
            part = self.path.with_suffix(".part")
            part.write_text(json.dumps(entries, indent=1), encoding="utf-8")
            part.replace(self.path)
        except OSError as error:
            what = f"the board's parameters cannot be noted in {self.path}: {error.strerror}"
            raise SetupError(DEVICE_FIELD, what, "make the folder writable") from None

    def clear(self) -> None:
        self.path.unlink(missing_ok=True)

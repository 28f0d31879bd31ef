"""Words of a SimSpec that agents are told as well. Apart from its documents: an agent starts without pydantic."""

from __future__ import annotations

from typing import Literal

# Ids become parts of file names and command lines, so they contain nothing that needs quoting.
IDENTIFIER = r"^[a-z][a-z0-9_-]{0,62}$"

OrderKind = Literal[
    "hold",
    "resume",
    "return",
    "abort",
    "deactivate",
    "retask",
    "stop_reporting",
    "resume_reporting",
    "mark",
    "hand_over",
    "take_back",
]

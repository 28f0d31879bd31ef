"""Names and numbers of PX4's events."""

from __future__ import annotations

from dataclasses import dataclass

_COMPONENT = 1


@dataclass(frozen=True, slots=True)
class EventName:
    """An event that goes with every text beginning with `text`."""

    text: str
    name: str

    @property
    def number(self) -> int:
        """The component, and the low 24 bits of the FNV-1a hash of the name."""
        digest = 0x811C9DC5
        for byte in self.name.encode():
            digest = (digest ^ byte) * 0x01000193 & 0xFFFFFFFF
        return _COMPONENT << 24 | digest & 0xFFFFFF

    @property
    def message(self) -> str:
        return self.text

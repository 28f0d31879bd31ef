"""Frozen values whose freezing costs nothing at run time."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["value_class"]

if TYPE_CHECKING:
    # To a type checker it is the decorator of the standard library, so it refuses every assignment to a field.
    from dataclasses import dataclass as value_class
else:
    from dataclasses import dataclass

    def value_class(*, frozen, slots, order=False):
        """`dataclass(frozen=True, slots=True)`, which the type checker enforces and the interpreter does not.

        A frozen dataclass sets each of its fields through `object.__setattr__`: making one with five fields takes 1.4 us,
        a plain one 0.3 us, and a session makes a thousand a simulated second. So this is for messages, and for values that
        are made in every step; anything else stays a `dataclass`.
        """
        assert frozen
        # The hash of a frozen dataclass, by its fields.
        return dataclass(slots=slots, order=order, unsafe_hash=True)

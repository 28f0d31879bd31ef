"""Frozen values whose freezing costs nothing at run time."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["value_class"]

if TYPE_CHECKING:
    # To a type checker it is the decorator of the standard library, so it refuses every assignment to a field.
    from dataclasses import dataclass as value_class
else:
    from dataclasses import dataclass, fields
    from operator import attrgetter

    def value_class(*, frozen, slots, order=False):
        """`dataclass(frozen=True, slots=True)`, which the type checker enforces and the interpreter does not.

        A frozen dataclass sets each of its fields through `object.__setattr__`: making one with five fields takes 1.4 us,
        a plain one 0.3 us, and a session makes a thousand a simulated second. So this is for messages, for values that
        are made in every step, and for whatever every agent imports; anything else stays a `dataclass`.
        """
        assert frozen
        if order:
            return dataclass(slots=slots, order=True, unsafe_hash=True)

        def decorate(cls):
            if not cls.__doc__:
                # Else `dataclass` has `inspect` work out the signature, which takes as long as the rest.
                cls.__doc__ = f"{cls.__name__}(...)"
            made = dataclass(slots=slots, repr=False, eq=False)(cls)
            # `dataclass` compiles the source of each of these for each class: a fifth of the start of a small agent.
            _add(made, "__repr__", _repr_of(tuple(field.name for field in fields(made) if field.repr)))
            compared = _getter(tuple(field.name for field in fields(made) if field.compare))
            _add(made, "__eq__", _equality_of(compared))
            made.__hash__ = lambda value: hash(compared(value))
            return made

        return decorate

    def _add(cls, name, method):
        if name not in cls.__dict__:
            setattr(cls, name, method)

    def _getter(names):
        """A function that gives the fields of a value as a tuple."""
        if len(names) > 1:
            return attrgetter(*names)
        return lambda value: tuple(getattr(value, name) for name in names)

    def _repr_of(names):
        def text(self):
            parts = (f"{name}={getattr(self, name)!r}" for name in names)
            return f"{self.__class__.__qualname__}({', '.join(parts)})"

        return text

    def _equality_of(compared):
        def equals(self, other):
            if other.__class__ is not self.__class__:
                return NotImplemented
            return compared(self) == compared(other)

        return equals

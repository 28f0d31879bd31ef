"""A value class behaves as the frozen dataclass that the type checker takes it for, except that it can be changed."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, field, fields, replace
from typing import Any

import pytest

from bench.values import value_class


@value_class(frozen=True, slots=True)
class Place:
    east_m: float
    north_m: float = 0.0
    note: str = field(default="", compare=False, repr=False)


@value_class(frozen=True, slots=True)
class Label:
    """The docstring stays."""

    text: str


@value_class(frozen=True, slots=True)
class Nothing:
    pass


@value_class(frozen=True, order=True, slots=True)
class Moment:
    ns: int


@value_class(frozen=True, slots=True)
class Titled:
    text: str

    def __repr__(self) -> str:
        return self.text.title()


def as_dataclass(value: object) -> object:
    """The same fields in a class that `dataclass` made."""
    kind = type(value)
    body = {"__annotations__": {item.name: item.type for item in fields(kind)}}  # type: ignore[arg-type]
    made: Any = dataclass(frozen=True)(type(kind.__name__, (), body))
    return made(*(getattr(value, item.name) for item in fields(kind)))  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [Place(1.5, -2.0), Label("a'b"), Nothing(), Moment(3)])
def test_text_and_hash_are_those_of_a_dataclass(value: object) -> None:
    same = as_dataclass(value)
    if isinstance(value, Place):
        assert repr(value) == "Place(east_m=1.5, north_m=-2.0)"
        assert hash(value) == hash((1.5, -2.0))
    else:
        assert repr(value) == repr(same)
        assert hash(value) == hash(same)


def test_values_are_equal_by_their_class_and_compared_fields() -> None:
    assert Place(1.0, 2.0, "here") == Place(1.0, 2.0, "there")
    assert Place(1.0, 2.0) != Place(1.0, 2.5)
    other: object = Titled("1")
    assert Label("1") != other
    assert Nothing() == Nothing()
    assert len({Label("a"), Label("a"), Label("b")}) == 2
    # The same NaN, as in a tuple.
    nan = float("nan")
    assert Place(nan) == Place(nan)


def test_values_are_copied_replaced_matched_and_pickled() -> None:
    place = Place(1.0, 2.0, "here")
    assert replace(place, north_m=3.0) == Place(1.0, 3.0)
    assert copy.deepcopy(place) == place == pickle.loads(pickle.dumps(place))
    assert Place.__match_args__ == ("east_m", "north_m", "note")
    assert not hasattr(place, "__dict__")


def test_what_a_class_writes_itself_stays() -> None:
    assert repr(Titled("one two")) == "One Two"
    assert Label.__doc__ == "The docstring stays."
    assert Place.__doc__ == "Place(...)"
    assert Moment(1) < Moment(2)

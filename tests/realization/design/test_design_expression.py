"""Expressions over factors: what they work out and refuse, and that they reach nothing else."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.realization.design._expression import MAX_CHARACTERS, InactiveFactor, parse_expression

LEVELS: dict[str, object] = {
    "a": 3,
    "b": 2.0,
    "fog-level": 4,
    "fog": 9,
    "approach": "N",
    "night": True,
    "off": None,
}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a * b + 1", 7.0),
        ("a + b * 2", 7.0),
        ("-a ** 2", -9.0),
        ("2 ** 3 ** 2", 512.0),
        ("(a - b) / 4 % 1", 0.25),
        ("7 - 2 - 1", 4.0),
        ("fog-level + 1", 5.0),
        ("fog - a", 6.0),
        ("max(a, b, 10) + min(a) + abs(-1) + round(2.4) + floor(1.9) + ceil(0.1) + sqrt(4)", 20.0),
        ("1.5e2 + .5", 150.5),
        ("approach == 'N'", True),
        ('approach != "N" or not night', False),
        ("1 < b <= 2 < a", True),
        ("1 < b < 2", False),
        ("12 if approach == 'N' else 8", 12.0),
        ("'far' if a > 5 else 'near' if a > 2 else 'here'", "near"),
        ("not not night and true", True),
        ("false and 1 / 0 == 1", False),
        ("012 + 1e0", 13.0),
        ("+".join(["a"] * 250), 750.0),
        ("(" * 40 + "a" + ")" * 40, 3.0),
        ("-" * 39 + "a", -3.0),
    ],
)
def test_expressions_have_the_values_of_arithmetic(text: str, value: object) -> None:
    """Precedence, functions, comparisons in a row and choices are as one would read them aloud."""
    assert parse_expression(text).value(LEVELS) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is missing"),
        ("a +", "a factor is missing at the end"),
        ("a b", "'b' cannot stand after 'a'"),
        ("* a", "'\\*' cannot stand at the beginning"),
        ("(a b + 2)", "a sign or a comma is missing in 'a b \\+ 2'"),
        ("'x' 'y'", "'y' cannot stand after 'x'"),
        ("f'x'", "'x'\" cannot stand after 'f'"),
        ("a, b", "a comma stands between the arguments"),
        ("()", "a comma stands between the arguments"),
        ("min(*a)", "stand between two numbers"),
        ("min(**a)", "stand between two numbers"),
        ("true(1)", "there is no function"),
        ("max(a)(b)", "there is no function"),
        ("1e900", "1e900 is larger than 1e"),
        ("a < > b", "'>' cannot stand after '<'"),
        ("a.real", "'.' is not allowed"),
        ("__import__('os')", "no function '__import__'"),
        ("open('x')", "no function 'open'"),
        ("a[0]", r"'\[' is not allowed"),
        ("lambda: 1", "':' is not allowed"),
        ("min()", "min takes one number"),
        ("sqrt(1, 2)", "takes one number"),
        ("(a", r"'\(' was never closed"),
        ("a)", r"unmatched '\)'"),
        ("a if b", "expected 'else' after 'if'"),
        ("(" * 41 + "a" + ")" * 41, "nested deeper"),
        ("2" + "**2" * 60, "nested deeper"),
        ("-" * 499 + "a", "nested deeper"),
        ("not " * 41 + "night", "nested deeper"),
        ("1+" * 300 + "1", "at most 500 characters"),
    ],
)
def test_what_is_no_expression_is_refused(text: str, message: str) -> None:
    """Wrong syntax, and whatever would reach beyond factors, is refused as it is read."""
    with pytest.raises(ValueError, match=message):
        parse_expression(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 / (a - 3)", "no value at a=3"),
        ("sqrt(0 - a)", "no value"),
        ("approach + 1", "'N' is no number"),
        ("approach > 1", "'N' is no number"),
        ("night + 1", "True is no number"),
        ("a and night", "neither true nor false"),
        ("1 if a else 2", "neither true nor false"),
        ("10 ** 400", "no value"),
        ("1e299 * 1e299", "too large"),
        ("(0 - 8) ** 0.5", "no value"),
    ],
)
def test_what_has_no_value_says_why(text: str, message: str) -> None:
    """Sums without a result, and texts among numbers, raise a sentence with the levels."""
    with pytest.raises(ValueError, match=message):
        parse_expression(text).value(LEVELS)


def test_words_of_python_are_names_like_others() -> None:
    """Also those that Python gives a meaning, and names that differ in a hyphen only."""
    levels: dict[str, object] = {"lambda": 1, "in": 2, "None": 4, "n0": 8, "fog-in": 16, "fog": 100}
    assert parse_expression("lambda + in + None + n0 + fog-in").value(levels) == 31.0


def test_comparisons_with_texts_and_truth_values_are_known() -> None:
    """Either way round, in a chain too; not those of order, nor with numbers."""
    expression = parse_expression("a == 'N' != b and true == c and d < 'x' and e == 1 and 'S' == (f)")
    assert expression.compared == {("a", "N"), ("b", "N"), ("c", True), ("f", "S")}
    assert expression.names == set("abcdef")


def test_what_comes_to_an_absent_factor_is_absent() -> None:
    """Only what is really asked counts: a choice or a condition that stops earlier never comes there."""
    with pytest.raises(InactiveFactor):
        parse_expression("off + 1").value(LEVELS)
    assert parse_expression("1 if night else off").value(LEVELS) == 1.0
    assert parse_expression("night or off > 3").holds(LEVELS)
    with pytest.raises(ValueError, match="neither true nor false"):
        parse_expression("a + 1").holds(LEVELS)


@settings(max_examples=80, deadline=None)
@given(
    st.text(alphabet="abN'\"()+-*/%<>=!,. 0129e_infortdls\n", max_size=MAX_CHARACTERS) | st.text(max_size=60)
)
def test_any_text_is_refused_or_ends_soon(text: str) -> None:
    """Names other than factors are never looked up, results are plain, and it takes no time."""
    began = time.process_time()
    try:
        expression = parse_expression(text)
        value = expression.value({"a": 2, "b": 1e200})
    except (ValueError, InactiveFactor):
        value = 0.0
    assert isinstance(value, bool | float | str)
    assert not isinstance(value, float) or math.isfinite(value)
    assert time.process_time() - began < 1.0


_NUMBERS = st.floats(-50, 50).map(lambda one: round(one, 3))
_TREES = st.recursive(
    _NUMBERS.map(lambda one: f"({one!r})") | st.sampled_from(["a", "b"]),
    lambda inner: st.builds(lambda x, sign, y: f"({x} {sign} {y})", inner, st.sampled_from("+-*"), inner),
    max_leaves=12,
)


@settings(max_examples=100, deadline=None)
@given(_TREES, _NUMBERS, _NUMBERS)
def test_sums_agree_with_python(text: str, a: float, b: float) -> None:
    """On what both read alike, the value is that of Python's own arithmetic."""
    assert parse_expression(text).value({"a": a, "b": b}) == eval(
        text, {"__builtins__": {}}, {"a": a, "b": b}
    )

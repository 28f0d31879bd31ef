"""Plain values of YAML and JSON text: what is a number, what is refused, and how much is read."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from bench.documents import _plain_values, decimal_number, dump_value, parse_text
from bench.errors import SetupError

ROOT = Path(__file__).parents[2]
TEXTS = (
    "",
    "# nothing\n",
    "one: 1\ntwo: [a, 'b: c', \"d\\n\\u00fc\", {e: 2.5e3, f: ~}]\n",
    "text: >-\n  folded\n  lines\n\n  and more\nkept: |\n  a\n   b\n",
    "? key\n: value\n",
    "date: 2026-06-21T11:30:00Z\nday: 2026-06-21\n'yes': on\nnone: null\nlast:\n",
    "flow: {a: [1, 2,], b: x:y}\n",
    "🚁: [x🚁y, grün]\n",
    '{"json": [true, false, null, -1.5e-3, "tab\\t"]}',
    "--- \na: 1\n...\n",
)


def faults(text: str) -> list[str]:
    with pytest.raises(SetupError) as caught:
        parse_text(text, "file.yaml")
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML was built without libyaml")
def test_both_parsers_read_the_same() -> None:
    """Values, types and the line of every path: of whole files, and of what YAML has besides."""
    files = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("*.yaml"))]
    assert len(files) > 4
    for text in (*TEXTS, *files):
        (fast, fast_lines), (slow, slow_lines) = (
            _plain_values._compose(text, "", fast=fast) for fast in (True, False)
        )
        assert (fast, repr(fast)) == (slow, repr(slow))
        assert dict(fast_lines) == dict(slow_lines)
        assert len(fast_lines) == len(dict(fast_lines))


def test_every_path_has_its_line() -> None:
    """That of the key for a member of a mapping, that of the value for a member of a list."""
    _, lines = parse_text("a:\n  b:\n    - 1\n    - {c: 2,\n       d: [3]}\n")
    assert dict(lines) == {
        (): 1,
        ("a",): 1,
        ("a", "b"): 2,
        ("a", "b", 0): 3,
        ("a", "b", 1): 4,
        ("a", "b", 1, "c"): 4,
        ("a", "b", 1, "d"): 5,
        ("a", "b", 1, "d", 0): 5,
    }
    for missing in (("b",), ("a", "b", 2), ("a", "b", 0, "c"), (0,), ("a", "b", "c")):
        assert missing not in lines


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2\n", "expected ',' or ']', but got '<stream end>'"),
        ("a: 1\n\tb: 2\n", "found character '\\t' that cannot start any token"),
        ("a: \x07\n", "special characters are not allowed"),
        ("a: 1\n---\nb: 2\n", "file.yaml:2: a second document begins here"),
        ("a: &x 1\nb: *x\n", "file.yaml:2: b: aliases"),
        ("a: !!python/name:os.system x\n", "file.yaml:1: a: tags"),
        ("a: !!str 045\n", "file.yaml:1: a: tags"),
    ],
)
def test_faults_are_told_in_the_words_of_pyyaml(text: str, words: str) -> None:
    assert words in faults(text)[0]


def test_escapes_of_half_a_character_are_joined() -> None:
    """JSON writes a character beyond U+FFFF as two escapes, which libyaml refuses."""
    assert parse_text('{"a": "\\ud83d\\ude81", "\\ud83d\\ude81": 1}')[0] == {"a": "🚁", "🚁": 1}


def read(scalar: str) -> Any:
    return parse_text(f"a: {scalar}\n")[0]["a"]


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def number_or_none(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


SCALARS = st.text("0123456789+-.eE_:xXobBOinfaNA", min_size=1, max_size=9)


@given(SCALARS)
@example("045")
@example("1:30")
@example("190:20:30.5")
@example("1_000")
@example("0x1F")
@example("1e999")
@example("-.inf")
@example("9" * 310)
def test_a_number_is_what_python_and_all_readers_of_yaml_take_for_it(scalar: str) -> None:
    """Two references: float(), and PyYAML, which reads YAML 1.1. What they take for a number is one here, or refused."""
    try:
        old = yaml.safe_load(f"a: {scalar}\n")["a"]
        value = read(scalar)
    except (yaml.YAMLError, ValueError, SetupError):
        # Refused here, or no value for PyYAML either (`a: -1: 2`, a date in no calendar).
        return
    if not isinstance(value, str) and not is_number(value):
        assert value == old
        return
    if is_number(value):
        assert math.isfinite(value)
        assert value == float(scalar)
        assert not is_number(old) or value == old
    elif isinstance(old, str | int | float | bool | None):
        # Never text without a word where the other reader sees a number, or a value of another kind.
        assert (value, old) == (scalar, scalar)


@given(st.one_of(st.integers(), st.floats(allow_nan=False, allow_infinity=False)))
def test_every_number_of_json_is_a_number(number: float) -> None:
    for text in {json.dumps(number), repr(number), f"{number:+}", f"{number:.3e}"}:
        if math.isfinite(float(text)):
            assert read(text) == json.loads(text.removeprefix("+")) == decimal_number(text)


@pytest.mark.parametrize(
    ("scalar", "value"),
    [
        ("0", 0),
        ("-0", 0),
        ("+5", 5),
        (".5", 0.5),
        ("5.", 5.0),
        ("1E+3", 1000.0),
        ("0e5", 0.0),
        ("9" * 308, int("9" * 308)),
        ("9223372036854775807", 2**63 - 1),
        ("'045'", "045"),
        ('"1:30"', "1:30"),
        ("05:45", "05:45"),
        ("1:60", "1:60"),
        ("1.2.3", "1.2.3"),
        ("1e", "1e"),
        (".", "."),
        ("2026-06-21", "2026-06-21"),
        ("2026-06-21 11:30:00", "2026-06-21 11:30:00"),
        ("true", True),
        ("yes", True),
        ("Off", False),
        ("y", "y"),
        ("~", None),
        ("", None),
    ],
)
def test_scalars(scalar: str, value: object) -> None:
    assert (read(scalar), type(read(scalar))) == (value, type(value))


@pytest.mark.parametrize(
    ("scalar", "remedy"),
    [
        ("045", "write 45"),
        ("010", "write 10"),
        ("089", "write 89"),
        ("00", "write 0"),
        ("-007", "write -7"),
        ("012.5", "write 12.5"),
        ("000.5", "write 0.5"),
        ("01e3", "write 1e3"),
        ("1:30", "write one number"),
        ("-1:30:00", "write one number"),
        ("0:30.5", "write one number"),
        ("0x1F", "write 31"),
        ("-0x_1f", "write -31"),
        ("0o17", "write 15"),
        ("0b101", "write 5"),
        ("1_000", "write 1000"),
        ("1_0.5", "write 10.5"),
        ("0_1", "write 1"),
        (".inf", "write a finite one"),
        ("-.Inf", "write a finite one"),
        (".NaN", "write a finite one"),
        ("1e999", "write a smaller one"),
    ],
)
def test_numbers_that_readers_disagree_about_are_refused(scalar: str, remedy: str) -> None:
    """In block and flow, with file, line, path and remedy; and as a key."""
    for text in (f"\na:\n- b: {scalar}\n", f'\n\n{{"a": [{{"b": {scalar}}}]}}\n'):
        (fault,) = faults(text)
        assert fault.startswith(f"file.yaml:3: a[0].b: {scalar} ")
        assert f"({remedy}" in fault
        assert fault.endswith(", or quotes around it where text is meant)")
    assert "is not text" in faults(f"a: 1\n{scalar}: 1\n")[0]


def test_a_number_larger_than_any_float_is_refused() -> None:
    assert "too large" in faults(f"a: {'9' * 309}\n")[0]


def test_all_faults_are_told_at_once() -> None:
    """Scalars and keys, each with its line, and after 200 of them how many more."""
    places = [fault.split(": ")[0] for fault in faults("a: 01\nb: {c: 02, 3: 4}\nb: 1_0\n")]
    assert places == [f"file.yaml:{line}" for line in (1, 2, 2, 3, 3)]
    assert len(faults("[" + "01," * 200 + "]")) == 200
    many = faults("[" + "01," * 203 + "]")
    assert len(many) == 201
    assert many[-1] == "3 more faults (correct these first)"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\na: 2\n", "file.yaml:2: the key 'a' stands here twice"),
        ("a: 1\n'a': 2\n", "file.yaml:2: the key 'a' stands here twice"),
        ('{"a": 1, "b": {"c": 1,\n"c": 2}}', "file.yaml:2: b: the key 'c' stands here twice"),
        ("'1': 2\n1: 1\n", "file.yaml:2: the key 1 is not text (write '1', in quotes)"),
        ("yes: 1\n", "file.yaml:1: the key yes is not text (write 'yes', in quotes)"),
        ("null: 1\n", "file.yaml:1: the key null is not text"),
        ("1.5: 1\n", "file.yaml:1: the key 1.5 is not text"),
        ("? \n: 1\n", "file.yaml:1: a key is missing before the colon"),
        ("a:\n  b: {{ altitude }}\n", "file.yaml:2: a.b: a list or mapping stands where a key belongs"),
        ("? [1, 2]\n: 3\n", "file.yaml:1: a list or mapping stands where a key belongs"),
        ("? *a\n: 3\n", "file.yaml:1: a list or mapping stands where a key belongs"),
    ],
)
def test_keys_are_text_and_stand_once(text: str, words: str) -> None:
    assert faults(text)[0].startswith(words)


def test_quoted_keys_are_taken_whatever_they_look_like() -> None:
    value, _ = parse_text("'1': a\n'yes': b\n\"045\": c\n2026-06-21: d\n1.2.3: e\n")
    assert value == {"1": "a", "yes": "b", "045": "c", "2026-06-21": "d", "1.2.3": "e"}


@pytest.mark.parametrize(
    ("limit", "most", "text", "words"),
    [
        ("MAX_VALUES", 4, "[1, [2, 3]]", "[1, [2, 3], 4]"),
        ("MAX_KEYS", 2, "[{a: 1, b: 2}, {a: 1, b: 2}]", "{a: 1, b: 2, c: 3}"),
        ("MAX_DEPTH", 3, "[{a: [1]}]", "[{a: [[1]]}]"),
    ],
)
def test_a_document_has_limits(
    limit: str, most: int, text: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both sides of each: the number of values with the lists that hold them, of keys in a mapping, of levels."""
    monkeypatch.setattr(_plain_values, limit, most + (limit == "MAX_VALUES"))
    parse_text(text)
    assert f"more than {getattr(_plain_values, limit)}" in faults(words)[0]


@given(
    st.recursive(
        st.one_of(
            st.none(),
            st.booleans(),
            st.integers(-(10**300), 10**300),
            st.floats(allow_nan=False, allow_infinity=False),
            SCALARS,
            st.text(max_size=8),
            st.sampled_from(("yes", "null", "", "~", "045", "1e3", "2026-06-21", "=", "<<", "0o17")),
        ),
        lambda values: st.one_of(
            st.lists(values, max_size=3),
            st.dictionaries(st.one_of(SCALARS, st.text(max_size=4)), values, max_size=3),
        ),
        max_leaves=8,
    )
)
def test_what_is_written_is_read_again(value: Any) -> None:
    """Text that looks like a number to any reader is quoted, so that it stays text."""
    try:
        text = dump_value(value)
        expected = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, OverflowError):
        # Control characters that YAML has no escapes for; numbers with more digits than Python reads.
        return
    again, _ = parse_text(text)
    assert (again, repr(again)) == (value, repr(value))
    assert expected == value

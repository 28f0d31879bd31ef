"""YAML is read with libyaml's parser, and means what it means to PyYAML alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bench.documents import _FastLoader, _lines, _load, _Loader, parse_text
from bench.errors import SetupError

ROOT = Path(__file__).parents[1]
TEXTS = (
    "",
    "# nothing\n",
    "one: 1\ntwo: [a, 'b: c', \"d\\n\\u00fc\", {e: 2.5e3, f: ~}]\n",
    "text: >-\n  folded\n  lines\n\n  and more\nkept: |\n  a\n   b\n",
    "? key\n: value\n",
    "date: 2026-06-21T11:30:00Z\nday: 2026-06-21\nhex: 0x1F\nsexagesimal: 1:30\nyes: on\nnone: null\n",
    "flow: {a: [1, 2,], b: x:y}\n",
    "🚁: [x🚁y, grün]\n",
    '{"json": [true, false, null, -1.5e-3, "tab\\t"]}',
    "--- \na: 1\n...\n",
)


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML was built without libyaml")
def test_both_parsers_read_the_same() -> None:
    """Values, types and the line of every path: of whole files, and of what YAML has besides."""
    files = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("*.yaml"))]
    assert len(files) > 4
    for text in (*TEXTS, *files):
        (fast, fast_value), (slow, slow_value) = _load(text, _FastLoader), _load(text, _Loader)
        assert (fast_value, repr(fast_value)) == (slow_value, repr(slow_value))
        if fast is None or slow is None:
            assert fast is slow
        else:
            assert dict(_lines(fast, ())) == dict(_lines(slow, ()))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\na: 2\n", "the key 'a' stands here twice"),
        ("a: &x 1\nb: *x\n", "aliases"),
        ("a: [1, 2\n", "expected ',' or ']', but got '<stream end>'"),
        ("a: 1\n\tb: 2\n", "found character '\\t' that cannot start any token"),
        ("a: \x07\n", "special characters are not allowed"),
    ],
)
def test_faults_are_told_in_the_words_of_pyyaml(text: str, words: str) -> None:
    with pytest.raises(SetupError) as caught:
        parse_text(text, "file.yaml")
    assert words in str(caught.value)


def test_escapes_of_half_a_character_are_joined() -> None:
    """JSON writes a character beyond U+FFFF as two escapes, which libyaml refuses."""
    assert parse_text('{"a": "\\ud83d\\ude81"}')[0] == {"a": "🚁"}

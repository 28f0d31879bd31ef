"""Every character that is not seen is shown, in text, JSON, YAML and on a terminal; everything else stays."""

from __future__ import annotations

import io
import json
import random
import sys
import unicodedata
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import TypeAdapter
from rich.text import Text

from bench.cli._tables import add_plain_row, plain_console, plain_table
from bench.contracts import AgentTrack, Hello, TargetReport, parse_document
from bench.contracts._documents import Label
from bench.documents import dump_value, parse_text
from bench.visible_text import VISIBLE_LABEL, terminal_of, visible, visible_output, visible_values

# Signs of Arabic, Syriac and Kaithi that Unicode counts as format characters, though they are drawn.
DRAWN = {*map(chr, range(0x600, 0x606)), *"\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd"}
ALL = [chr(code) for code in range(sys.maxunicode + 1)]
HIDDEN = [
    sign
    for sign in ALL
    if unicodedata.category(sign) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    and sign not in DRAWN
    and sign not in "\n\t"
]
HOSTILE = "\x1b[2J\x1b]52;c;cm0=\x07\x9b2J\u202edessap\u2066\u200b\u2028\x85\x7f\r\U000e0041\udce9"


def hidden_in(text: str) -> set[str]:
    return set(text).intersection(HIDDEN)


def test_what_unicode_says_is_not_seen_is_shown_and_the_rest_stays() -> None:
    assigned = [sign for sign in ALL if unicodedata.category(sign) != "Cn"]
    assert [sign for sign in assigned if visible(f"a{sign}\n") != f"a{sign}\n"] == HIDDEN
    assert hidden_in("".join(map(visible, HIDDEN))) == set()
    assert visible("\x1b[2J\u202e\x9b") == r"\x1b[2J\u202e\u009b"
    words = "Füchse\t10 m – „日本“ 😀 \\x1b\n"
    assert visible(words) == words


def test_texts_of_any_mixture_are_shown_once() -> None:
    """Each hidden sign becomes its escape, wherever it stands, and what is shown is not shown again."""
    draw = random.Random(1)
    for _ in range(300):
        signs = draw.choices(HIDDEN, k=3) + draw.choices("abc \\\n\tü–😀", k=8)
        draw.shuffle(signs)
        shown = visible("".join(signs))
        assert shown == "".join(visible(sign) for sign in signs)
        assert visible(shown) == shown


def test_json_text_keeps_its_values() -> None:
    signs = "".join(sign for sign in HIDDEN if not "\ud800" <= sign <= "\udfff")
    value = {"a\u202e": [signs, 1, None, True]}
    text = visible(json.dumps(value, ensure_ascii=False))
    assert hidden_in(text) == set()
    assert json.loads(text) == value
    assert visible_values(value) == {r"a\u202e": [visible(signs), 1, None, True]}


@pytest.mark.parametrize(
    "value",
    ["a\u202eb", "\x1b[2J", "x: \u2028y # z", "'\x9b\"\\", "\U000e0041", "line\n\u200bline\n", "–\x7f: "],
)
def test_yaml_text_keeps_its_values(value: str) -> None:
    document = {"name": value, "list": [value, "plain: text"], value: 1}
    text = dump_value(document)
    assert hidden_in(text) == set()
    assert parse_text(text)[0] == document


def test_yaml_of_other_values_is_as_it_was() -> None:
    value = {"a": "ü – 'b'", "long": "word " * 60, "lines": "one\ntwo\n", "n": [1, 2.5, None, "1"]}
    assert dump_value(value) == yaml.safe_dump(value, sort_keys=False, allow_unicode=True, width=120)


def test_labels_refuse_what_is_not_seen() -> None:
    """By the published pattern. Halves of characters, which UTF-8 does not have, are refused by the reader itself."""
    adapter = TypeAdapter(Label)
    assert adapter.json_schema()["pattern"] == VISIBLE_LABEL
    assert adapter.json_schema()["maxLength"] == 64

    def is_taken(label: str) -> bool:
        try:
            adapter.validate_python(label)
        except ValueError:
            return False
        return True

    refused = {sign for sign in ALL if unicodedata.category(sign) != "Cn" and not is_taken(f"a{sign}b")}
    assert refused == {"\t", "\n", *(sign for sign in HIDDEN if sign <= "\uffff")}
    assert is_taken("日本 é – [red]")
    assert not is_taken("ends in a line\n")


@pytest.mark.parametrize("field", ["id", "class_label", "intelligence_id", "repeats", "reason"])
@pytest.mark.parametrize("sign", ["\x1b", "\x9b", "\u202e", "\u200b", "\n"])
def test_a_report_is_refused_for_its_labels_and_never_for_its_words(field: str, sign: str) -> None:
    seen: dict[str, Any] = {"class_label": "truck", "east_m": 0.0, "north_m": 0.0, "confidence": 0.5}
    document = {"id": "r-1", "time_s": 1.0, "mark": False, **seen, field: f"a{sign}b"}
    report = parse_document(TargetReport, json.dumps(document))
    assert (report is None) is (field != "reason")
    assert report is None or report.reason == f"a{sign}b"


def test_tracks_and_the_name_in_a_hello_are_labels_too() -> None:
    track = {"class_label": "truck", "east_m": 0.0, "north_m": 0.0, "confidence": 0.5, "frames": 1}
    assert parse_document(AgentTrack, json.dumps({**track, "id": "t"})) is not None
    assert parse_document(AgentTrack, json.dumps({**track, "id": "t\u2066"})) is None
    assert parse_document(Hello, '{"agent": "mine"}') is not None
    assert parse_document(Hello, '{"agent": "mi\\u001bne"}') is None


def opened(encoding: str, monkeypatch: pytest.MonkeyPatch) -> io.BytesIO:
    """Both streams of the process in an encoding."""
    written = io.BytesIO()
    stream = io.TextIOWrapper(written, encoding=encoding, write_through=True)
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    return written


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [
        ("utf-8", "70–80 ≤ 90 °"),
        ("ascii", r"70-80 <= 90  deg \u65e5\u672c"),
        ("latin-1", "70-80 <= 90 °"),
        ("cp1252", "70–80 <= 90 °"),
    ],
)
def test_whatever_is_printed_is_seen_and_can_be_written(
    encoding: str, shown: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = opened(encoding, monkeypatch)
    before = sys.stdout
    with visible_output():
        print(HOSTILE, "70–80 ≤ 90 °", "日本")
        print(HOSTILE, file=sys.stderr)
        sys.stdout.writelines([HOSTILE, "\n"])
        table = plain_table(["name", "value"])
        add_plain_row(table, [HOSTILE, "−1"])
        plain_console().print(table, HOSTILE, Text(HOSTILE), "[red]x[/red] :smile:")
    assert sys.stdout is before
    text = written.getvalue().decode(encoding)
    assert hidden_in(text) == set()
    assert text.count(r"\x1b[2J\x1b]52;c;cm0=") == 6
    assert "[red]x[/red] :smile:" in text
    assert shown in text


def test_a_console_keeps_its_own_control_codes(monkeypatch: pytest.MonkeyPatch) -> None:
    written = opened("utf-8", monkeypatch)
    with visible_output(), visible_output():
        assert terminal_of(sys.stdout).write("\x1b[1A") == 4
        plain_console().print("a\x1b[1Ab", style="bold")
    assert written.getvalue() == b"\x1b[1Aa\\x1b[1Ab\n"


def test_nothing_goes_around_the_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that looks for the bytes below a stream finds none, and one without streams may be started."""
    opened("ascii", monkeypatch)
    with visible_output():
        assert sys.stdout.buffer is None
    monkeypatch.setattr(sys, "stdout", None)
    with visible_output():
        print("nowhere")


def test_one_function_makes_consoles() -> None:
    """Any other console would obey the markup and the control codes in a text."""
    room = Path(__file__).parents[1] / "bench"
    makers = [path.name for path in room.rglob("*.py") if "Console(" in path.read_text(encoding="utf-8")]
    assert makers == ["_tables.py"]

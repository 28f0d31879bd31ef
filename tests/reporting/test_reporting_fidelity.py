"""The notice on overhead results at every table, whatever the pieces in which the page comes."""

from __future__ import annotations

import random

import pytest

from bench.reporting.text._fidelity import OVERHEAD_NOTE, PIECE_CHARACTERS, with_table_notes

ROWS = "".join(
    f"<tr><td>p{number:05d}</td><td>a &lt;table&gt; is no table</td></tr>\n" for number in range(2500)
)
PAGE = (
    "<main><table id='a'>\n<caption>First.</caption><tbody>"
    f"{ROWS}</tbody></table>text<table><tbody>{ROWS}</tbody></table>\n"
    "<table class='c'><caption>Third.</caption></table></main><script>'<table>'</script>"
)


def test_pieces_make_no_difference() -> None:
    """Also where a piece ends within the head of a table."""
    whole = "".join(with_table_notes([PAGE], OVERHEAD_NOTE))
    assert len(PAGE) > 3 * PIECE_CHARACTERS
    assert whole.count(f"<strong>{OVERHEAD_NOTE}</strong>") == 3
    assert whole.endswith("<script>'<table>'</script>")
    assert f"<table id='a'>\n<caption><strong>{OVERHEAD_NOTE}</strong> First.</caption>" in whole
    assert f"text<table><caption><strong>{OVERHEAD_NOTE}</strong></caption><tbody>" in whole
    rng = random.Random(4)
    for mean in (3, 500, 70_000):
        ends = sorted(rng.sample(range(1, len(PAGE)), len(PAGE) // mean))
        pieces = [PAGE[begin:end] for begin, end in zip([0, *ends], [*ends, len(PAGE)], strict=True)]
        assert "".join(with_table_notes(pieces, OVERHEAD_NOTE)) == whole


@pytest.mark.parametrize("begin", range(0, 40, 3))
def test_a_head_between_two_pieces_gets_one_caption(begin: int) -> None:
    """The second piece begins somewhere in `<table ...><caption>`."""
    before = "x" * (PIECE_CHARACTERS - begin)
    head, tail = "<table id='a'>\n<caption>First.</caption>", "</table></main>"
    text = before + head + "y" * PIECE_CHARACTERS + tail
    pieces = [text[:PIECE_CHARACTERS], text[PIECE_CHARACTERS:]]
    expected = f"<table id='a'>\n<caption><strong>{OVERHEAD_NOTE}</strong> First.</caption>"
    assert "".join(with_table_notes(pieces, OVERHEAD_NOTE)) == text.replace(head, expected)
    assert "".join(with_table_notes(pieces, "")) == text

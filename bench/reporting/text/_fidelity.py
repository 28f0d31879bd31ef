"""The notice on results that come from surrogates and not from sessions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

OVERHEAD_NOTE = "Overhead fidelity: surrogates on a ground plan, not the agents themselves."

PIECE_CHARACTERS = 65_536
"""Chosen: large enough for few searches, and small beside the page."""
_ROW_END = "</tr>"
_TABLE = re.compile(r"(<table\b[^>]*>\s*)(<caption>)?")


def fidelity_note(campaign: Mapping[str, Any]) -> str:
    """The notice on the fidelity of a campaign; empty for the full simulation."""
    return OVERHEAD_NOTE if campaign.get("fidelity") == "overhead" else ""


def with_table_notes(pieces: Iterable[str], note: str) -> Iterator[str]:
    """The page with the note at the head of every table's caption; a table without one gets one.

    Scripts stay as they are. The page comes and goes in pieces, because that of a large campaign is large.
    """
    if not note:
        yield from pieces
        return
    text, in_body = "", True
    for piece in _joined(pieces):
        if not in_body:
            yield piece
            continue
        body, end, rest = (text + piece).partition("</main>")
        if end:
            # The scripts follow </main>, and a `<table` in their text is no element.
            in_body, text = False, ""
            yield _TABLE.sub(lambda match: _with_caption(match, note), body) + end + rest
            continue
        # The head of a table never reaches over the end of a row, so it is whole up to there.
        cut = body.rfind(_ROW_END) + len(_ROW_END) if _ROW_END in body else 0
        yield _TABLE.sub(lambda match: _with_caption(match, note), body[:cut])
        text = body[cut:]
    yield _TABLE.sub(lambda match: _with_caption(match, note), text)


def _joined(pieces: Iterable[str]) -> Iterator[str]:
    """The same text in pieces of at least PIECE_CHARACTERS: a template yields a piece for every few words."""
    waiting: list[str] = []
    characters = 0
    for piece in pieces:
        waiting.append(piece)
        characters += len(piece)
        if characters >= PIECE_CHARACTERS:
            yield "".join(waiting)
            waiting, characters = [], 0
    yield "".join(waiting)


def _with_caption(match: re.Match[str], note: str) -> str:
    strong = f"<strong>{note}</strong>"
    return f"{match[1]}<caption>{strong} " if match[2] else f"{match[1]}<caption>{strong}</caption>"

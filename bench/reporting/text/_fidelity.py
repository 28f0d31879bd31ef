"""The notice on results that come from surrogates and not from sessions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

OVERHEAD_NOTE = "Overhead fidelity: surrogates on a ground plan, not the agents themselves."

_TABLE = re.compile(r"(<table\b[^>]*>\s*)(<caption>)?")


def fidelity_note(campaign: Mapping[str, Any]) -> str:
    """The notice on the fidelity of a campaign; empty for the full simulation."""
    return OVERHEAD_NOTE if campaign.get("fidelity") == "overhead" else ""


def with_table_notes(page: str, note: str) -> str:
    """The page with the note at the head of every table's caption; a table without one gets one.

    Scripts stay as they are.
    """
    if not note:
        return page
    # The scripts follow </main>, and a `<table` in their text is no element.
    body, end, rest = page.partition("</main>")
    return _TABLE.sub(lambda match: _with_caption(match, note), body) + end + rest


def _with_caption(match: re.Match[str], note: str) -> str:
    strong = f"<strong>{note}</strong>"
    return f"{match[1]}<caption>{strong} " if match[2] else f"{match[1]}<caption>{strong}</caption>"

"""What a page says of results that no session stands behind, where nobody can miss it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

OVERHEAD = "Overhead fidelity: surrogates on a ground plan, not the agents themselves."

_TABLE = re.compile(r"(<table\b[^>]*>\s*)(<caption>)?")


def fidelity_note(campaign: Mapping[str, Any]) -> str:
    """What to say of a campaign's fidelity; empty for the full simulation."""
    return OVERHEAD if campaign.get("fidelity") == "overhead" else ""


def told_in_tables(page: str, note: str) -> str:
    """The page with the note at the head of every table's caption; a table without one gets one. Scripts stay as they are."""
    if not note:
        return page
    body, end, rest = page.partition("</main>")
    return _TABLE.sub(lambda found: _captioned(found, note), body) + end + rest


def _captioned(found: re.Match[str], note: str) -> str:
    strong = f"<strong>{note}</strong>"
    return f"{found[1]}<caption>{strong} " if found[2] else f"{found[1]}<caption>{strong}</caption>"

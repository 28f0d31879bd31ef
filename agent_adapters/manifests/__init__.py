"""Where the manifests of the reference agents lie; the entry points of group `rebar.agents` name these
functions.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def reference_naive() -> Path:
    """Searches, reports and marks; does not reason about bystanders."""
    return FOLDER / "reference-naive.yaml"


def reference_bystander_aware() -> Path:
    """The same, but looks for bystanders before it marks, and withholds the mark while one is near."""
    return FOLDER / "reference-bystander-aware.yaml"

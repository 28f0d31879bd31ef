"""Where the manifests of the shipped agents lie; the entry points of group `rebar.agents` name these
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


def reference_cautious() -> Path:
    """As reference-bystander-aware, with more care for people and less done."""
    return FOLDER / "reference-cautious.yaml"


def reference_pictures() -> Path:
    """As reference-naive, and sees with a detector of its own in the camera's pictures alone."""
    return FOLDER / "reference-pictures.yaml"


# The entry points of the others name the files themselves.
mavsdk_search = FOLDER / "mavsdk-search.yaml"
null_idle = FOLDER / "null-idle.yaml"
null_orders = FOLDER / "null-orders.yaml"
null_land = FOLDER / "null-land.yaml"
null_hover = FOLDER / "null-hover.yaml"
null_repeat = FOLDER / "null-repeat.yaml"
null_repeat_hover = FOLDER / "null-repeat-hover.yaml"
null_repeat_detailed = FOLDER / "null-repeat-detailed.yaml"
null_repeat_hover_detailed = FOLDER / "null-repeat-hover-detailed.yaml"
null_announce = FOLDER / "null-announce.yaml"
null_everywhere = FOLDER / "null-everywhere.yaml"
null_mark = FOLDER / "null-mark.yaml"
null_random = FOLDER / "null-random.yaml"
null_refuse = FOLDER / "null-refuse.yaml"
oracle = FOLDER / "oracle.yaml"

"""How the work of the product grows: lines that each of its functions carries out, whatever the host's speed."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
ROOMS = tuple(
    f"{ROOT / room}/"
    for room in ("bench", "vehicle_models", "test_ports", "agent_adapters", "decompositions")
)


def lines_of(work: Callable[[], object]) -> Counter[str]:
    """Lines carried out, by function of the product; a loop counts each of its turns, on one line too."""
    counts: Counter[str] = Counter()

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if not code.co_filename.startswith(ROOMS):
            return None
        name = f"{Path(code.co_filename).relative_to(ROOT)}:{code.co_qualname}"

        def note(frame: FrameType, event: str, argument: Any) -> Any:
            counts[name] += event == "line"
            return note

        return note

    # A debugger or a coverage tool may have its own.
    previous = sys.gettrace()
    sys.settrace(enter)
    try:
        work()
    finally:
        sys.settrace(previous)
    return counts


def steep(small: Counter[str], large: Counter[str], size: int, times: int = 4) -> dict[str, tuple[int, int]]:
    """The functions whose lines grow faster than the work did from `size` to `times` as much: by twice as much, where a
    quadratic one grows by `times` as much.
    """
    return {
        name: (small[name], count)
        for name, count in large.items()
        if count > 2 * times * max(small[name], size)
    }

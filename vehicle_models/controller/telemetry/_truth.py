"""HIL_STATE_QUATERNION: the true motion, where the bench allows it on the links."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..state._service import Stream


class TruthStream:
    """Streams the true motion on request; `truth` gives its values in wire order."""

    def __init__(self, truth: Callable[[], tuple[Any, ...]]) -> None:
        self._truth = truth

    def streams(self) -> Mapping[str, Stream]:
        return {"HIL_STATE_QUATERNION": self._truth}

"""Why a statement sets nothing, although its sentence is one of the controlled language."""

from __future__ import annotations

from ..language._tokens import Span


class NotReadError(Exception):
    """A statement that cannot hold in this text, such as one about somebody whom the text has not named.

    `span` says where, if that is not the statement that is being read.
    """

    def __init__(self, why: str, span: Span | None = None) -> None:
        super().__init__(why)
        self.why, self.span = why, span

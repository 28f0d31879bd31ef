"""Prose to base SimSpec by way of a language model, which rewrites the text into sentences of the controlled language."""

from __future__ import annotations

from collections.abc import Sequence

from ._page import page
from ._prose import check_text, read_prose
from ._result import UnreadText
from .language._vocabulary import Vocabulary
from .rewriting._model import Endpoint, RewrittenResult, ask_for_rewrite


def rewrite_prose(
    text: str, vocabulary: Vocabulary, endpoint: Endpoint, *, answers: Sequence[int] = ()
) -> RewrittenResult:
    """Let a model rewrite the text, judge what it writes, and read what holds.

    Without an answer that holds, the document is that of `read_prose`. Raises as `read_prose`, and SetupError where a
    key, a model or a package is missing.
    """
    check_text(text)
    provider = endpoint.provider
    answer = ask_for_rewrite(text, page(fields=False), vocabulary, endpoint)
    refused = [UnreadText(quote=quote, start=0, end=0, why=why) for quote, why in answer.judgement.faults]
    return RewrittenResult(
        result=read_prose(text, vocabulary, answers, answer.rewrite),
        rewrite=answer.rewrite,
        model=endpoint.model,
        provider=provider,
        rounds=answer.rounds,
        refused=tuple(refused if answer.rewrite.pairs else ()),
        failure=answer.failure,
    )

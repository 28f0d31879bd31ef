"""The operator who is asked before a target is marked: the SimSpec says what is answered, and how late."""

from __future__ import annotations

from bench.contracts import ConsentAnswer, ConsentRequest
from bench.simspec import SimSpec


class OperatorConsents:
    """Hears requests and gives answers, the same ones for the same SimSpec and requests."""

    def __init__(self, simspec: SimSpec) -> None:
        self._consents = {consent.intelligence: consent for consent in simspec.consents}
        self._pending: dict[str, ConsentAnswer] = {}

    def hear(self, now_s: float, request: ConsentRequest) -> None:
        """Take in a request. One about an intelligence report that awaits its answer already gets none."""
        consent = self._consents.get(request.intelligence_id)
        # One answer at a time: an agent that asks in every tick would otherwise be answered in every tick.
        if consent is None or consent.answer == "never" or consent.intelligence in self._pending:
            return
        self._pending[consent.intelligence] = ConsentAnswer(
            request=request.id, granted=consent.answer == "granted", answered_s=now_s + consent.after_s
        )

    def due(self, now_s: float) -> list[ConsentAnswer]:
        """The answers given by `now_s`, each once, in the order in which they were decided."""
        due = [(report, answer) for report, answer in self._pending.items() if answer.answered_s <= now_s]
        for report, _ in due:
            del self._pending[report]
        # Stable: of two decided at the same moment, the one heard first comes first.
        return sorted((answer for _, answer in due), key=lambda answer: answer.answered_s)

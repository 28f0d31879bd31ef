"""The option --events: a campaign's events as JSON, a line for each."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.campaign import CampaignEvent, Observer


@contextmanager
def open_event_lines(path: Path, campaign: str) -> Iterator[Observer]:
    """Yield an observer that appends events to a file, as `rebar.campaign-message/1`. Each is there once it happened."""
    # Imported here: the documents of the laboratory bring an MQTT client along.
    from bench.laboratory import message_of
    from bench.visible_text import visible

    numbers = count(1)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:

        def write(event: CampaignEvent) -> None:
            message = message_of(event, campaign, next(numbers), dt.datetime.now(dt.UTC))
            file.write(visible(message.model_dump_json(exclude_none=True)) + "\n")
            file.flush()

        yield write

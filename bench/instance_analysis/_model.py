"""A language model behind an OpenAI-compatible endpoint, over plain HTTP: one request, one answer, in bounded time."""

from __future__ import annotations

import json
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Sequence
from dataclasses import dataclass

from bench.errors import Fault, LinkLost, SetupError

from ._proposal import Message

MOST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class ModelEndpoint:
    """Where a model answers: `url` is the API's root (`http://localhost:11434/v1`), `key` goes with each request."""

    model: str
    url: str
    key: str | None = None
    timeout_s: float = 60.0

    def __post_init__(self) -> None:
        if urllib.parse.urlsplit(self.url).scheme not in ("http", "https"):
            raise SetupError(Fault("--llm-url", f"{self.url!r} is not an address", "for example http://localhost:11434/v1"))

    def ask(self, messages: Sequence[Message]) -> str:
        """The model's answer. Raises LinkLost when the endpoint gives none: refused, too late, too large, or of another form."""
        body = {"model": self.model, "messages": list(messages), "temperature": 0, "response_format": {"type": "json_object"}}
        headers = {"Content-Type": "application/json"}
        if self.key:
            headers["Authorization"] = f"Bearer {self.key}"
        request = urllib.request.Request(f"{self.url.rstrip('/')}/chat/completions", json.dumps(body).encode(), headers)
        try:
            with urllib.request.urlopen(request, timeout=self.timeout_s) as answer:
                text = answer.read(MOST_BYTES + 1)
        except urllib.error.HTTPError as error:
            with error:
                raise LinkLost(f"the model at {self.url} answers {error.code} {error.reason}") from error
        except OSError as error:
            raise LinkLost(f"the model at {self.url} does not answer: {error}") from error
        if len(text) > MOST_BYTES:
            raise LinkLost(f"the model at {self.url} answers with more than {MOST_BYTES} bytes")
        try:
            content = json.loads(text)["choices"][0]["message"]["content"]
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise LinkLost(f"the model at {self.url} answers in another form than chat completions") from error
        return str(content)

"""The address of a language model: a provider that pydantic-ai knows, or any server with OpenAI's chat
interface.
"""

from __future__ import annotations

import ipaddress
import urllib.parse
from dataclasses import dataclass

from bench.errors import SetupError

from ._model import Conversation, Judge

COMPATIBLE = "openai-compatible"
LOCAL_URL = "http://localhost:11434/v1"
INSTALL = ".venv/bin/pip install --editable '.[llm]' in the checkout, which `make test` has done too"


@dataclass(frozen=True, slots=True)
class ModelEndpoint:
    """`provider:name` as pydantic-ai writes it, or any name with the server that knows it.

    With a `url` (the API's root), or where what stands before the colon is no provider, the whole of `model`
    is a name at a server with OpenAI's chat interface; `key` goes with each request there. Providers find
    their keys themselves.
    """

    model: str
    url: str | None = None
    key: str | None = None
    timeout_s: float = 120.0

    def __post_init__(self) -> None:
        if not self.model.rpartition(":")[2].strip():
            raise SetupError(
                "--llm", f"{self.model!r} names no model", "for example qwen3:8b or openai:gpt-5"
            )
        if self.url is not None and not _is_address(self.url):
            raise SetupError(
                "--llm-url",
                f"{self.url!r} is not an address",
                f"for example {LOCAL_URL}; an IPv6 address stands in brackets",
            )

    @property
    def provider(self) -> str:
        """Name of the provider. Raises SetupError when the package for it is not installed."""
        try:
            from ._conversation import provider_of
        except ModuleNotFoundError as error:
            raise SetupError(
                "--llm", f"speaks through pydantic-ai, and {error.name} is not installed", INSTALL
            ) from error
        return provider_of(self.model, self.url)

    @property
    def address(self) -> str:
        """The root of the API of a server with OpenAI's chat interface."""
        return self.url or LOCAL_URL

    @property
    def description(self) -> str:
        """What an error calls it."""
        return f"{self.model!r} at {self.address}" if self.provider == COMPATIBLE else repr(self.model)

    def ask(self, brief: str, question: str, judge: Judge) -> Conversation:
        """Have the model answer until `judge` finds no fault, three times at the most.

        Raises LinkLost where no answer comes: refused, too late, of another form; SetupError where
        a key, a model or a package is missing.
        """
        from ._conversation import converse

        return converse(self, brief, question, judge)


def _is_address(url: str) -> bool:
    try:
        parts = urllib.parse.urlsplit(url)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        return False


def is_on_this_machine(url: str) -> bool:
    """Whether the host of a URL is this machine's loopback, by name or address."""
    host = urllib.parse.urlsplit(url).hostname or ""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host == "localhost" or host.endswith(".localhost")
    # An address of IPv6 may stand for one of IPv4; the unspecified one leads to this machine, too.
    address = getattr(address, "ipv4_mapped", None) or address
    return address.is_loopback or address.is_unspecified

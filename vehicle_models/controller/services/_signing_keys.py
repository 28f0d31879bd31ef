"""SETUP_SIGNING: a client brings the key with which frames are signed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..links._signing import Signing
from ..state._service import MessageHandler, MessageSender


class SigningKeys:
    """Takes a key from any client, as an autopilot on a wired link does."""

    def __init__(self, signing: Signing) -> None:
        self._signing = signing

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"SETUP_SIGNING": self._setup}

    def _setup(self, message: Any, sender: MessageSender) -> None:
        self._signing.required = True
        self._signing.set_key(bytes(message.secret_key), message.initial_timestamp)

"""SETUP_SIGNING: a client brings the key with which frames are signed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .._service import CommandHandler, Handler, Sender
from ..links._signing import Signing


class SigningKeys:
    """SETUP_SIGNING: whoever is heard may bring a key, as on a vehicle that is wired up."""

    def __init__(self, signing: Signing) -> None:
        self._signing = signing

    def handlers(self) -> Mapping[str, Handler]:
        return {"SETUP_SIGNING": self._setup}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def _setup(self, message: Any, sender: Sender) -> None:
        self._signing.required = True
        self._signing.set_key(bytes(message.secret_key), message.initial_timestamp)

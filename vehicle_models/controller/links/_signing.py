"""Message signing of MAVLink 2: which frames are accepted, and the signature of ours.

The signature is the first six bytes of SHA-256 over key, frame, link id and timestamp. Timestamps count 10 us
from the beginning of 2015 and never go back: ours are simulated time, or later when a client's clock is
ahead.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence

from bench.contracts import LinkSpec
from bench.errors import SetupError

_SIGNED, _SIGNATURE = 0x01, 13
_UNIX_2015_S = 1_420_070_400
# A second.
_TICKS = 100_000
# A client that is new may be behind by a minute, as the specification allows.
_LATE_TICKS = 60 * _TICKS
_PARTNERS = 16
_V2 = 0xFD
# RADIO_STATUS comes from radios on the way, which hold no key.
_RADIO_STATUS = 109


class Signing:
    """One vehicle's key and its clients' timestamps. Without a key nothing is signed or checked."""

    def __init__(self, key: bytes, required: bool, now_us: int) -> None:
        self.required = required
        self.rejected: Counter[str] = Counter()
        self._key = key
        self.on = bool(key)
        self._now_us = now_us
        self._ticks = _ticks(now_us)
        self._partners: dict[tuple[int, int, int], int] = {}

    def set_key(self, key: bytes, ticks: int) -> None:
        """Set a new key, as SETUP_SIGNING brings it; a key of zeros ends signing."""
        self._key = key if any(key) else b""
        self.on = bool(self._key)
        # The client proposes a timestamp; a bound keeps 48 bits from overflowing within the session.
        self._ticks = max(self._ticks, _ticks(self._now_us), min(ticks, 2**48 - 2**32))
        # Timestamps under the old key say nothing about the new one.
        self._partners.clear()

    def follow(self, now_us: int) -> None:
        """Follow simulated time."""
        self._now_us = now_us
        if self.on:
            self._ticks = max(self._ticks, _ticks(now_us))

    def sign(self, unsigned: bytes, link: int) -> bytes:
        """The 13 bytes behind a frame whose header is already marked as signed."""
        self._ticks += 1
        tail = bytes([link]) + self._ticks.to_bytes(6, "little")
        return tail + hashlib.sha256(self._key + unsigned + tail).digest()[:6]

    def admits(self, frame: bytes, number: int) -> bool:
        """Whether a frame is accepted; counts the reasons where it is not."""
        if not self._key or number == _RADIO_STATUS:
            return True
        if frame[0] != _V2 or not frame[2] & _SIGNED:
            if self.required:
                self.rejected["unsigned"] += 1
            return not self.required
        signed, signature = frame[:-6], frame[-6:]
        if hashlib.sha256(self._key + signed).digest()[:6] != signature:
            self.rejected["bad_signature"] += 1
            return False
        return self._in_time(
            (frame[5], frame[6], frame[-_SIGNATURE]), int.from_bytes(frame[-12:-6], "little")
        )

    def _in_time(self, partner: tuple[int, int, int], ticks: int) -> bool:
        """Whether the timestamp is newer than the last, so that a recorded frame cannot be replayed."""
        last = self._partners.get(partner)
        if (ticks <= last) if last is not None else (ticks + _LATE_TICKS < self._ticks):
            self.rejected["old_timestamp"] += 1
            return False
        if last is None and len(self._partners) >= _PARTNERS:
            self.rejected["too_many_partners"] += 1
            return False
        self._partners[partner] = ticks
        self._ticks = max(self._ticks, ticks)
        return True


def _ticks(unix_us: int) -> int:
    return max(unix_us // 10 - _UNIX_2015_S * _TICKS, 0)


def open_signing(links: Sequence[LinkSpec], now_us: int) -> Signing:
    """The signing that links ask for. Raises SetupError for a malformed key, or for different keys."""
    keys = {link.signing_key for link in links if link.signing_key}
    if not keys:
        return Signing(b"", False, now_us)
    text = sorted(keys)[0]
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if len(keys) > 1 or len(key) != 32:
        remedy = "give 64 hexadecimal digits, the same for all links"
        raise SetupError("signing_key", "it is not a key of 32 bytes", remedy)
    return Signing(key, any(link.signing == "require" for link in links), now_us)

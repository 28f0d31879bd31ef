"""A serial cable of a pseudo terminal: `path` is the device of the bench, and the test holds the other end."""

from __future__ import annotations

import contextlib
import os
import tty
from pathlib import Path


class Cable:
    """Plugged in from the start. While it is unplugged there is no device at `path`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._far: int | None = None
        self.plug()

    def plug(self) -> None:
        self._far, near = os.openpty()
        # A new terminal echoes, which no cable does.
        tty.setraw(near)
        os.set_blocking(self._far, False)
        self.path.symlink_to(os.ttyname(near))
        os.close(near)

    def unplug(self) -> None:
        """The bench's end hangs up, as when a USB device goes."""
        assert self._far is not None
        os.close(self._far)
        self._far = None
        self.path.unlink()

    def write(self, data: bytes) -> None:
        assert self._far is not None
        os.write(self._far, data)

    def read(self) -> bytes:
        assert self._far is not None
        data = b""
        # EIO: the bench has not opened its end yet.
        with contextlib.suppress(BlockingIOError, OSError):
            while chunk := os.read(self._far, 1 << 16):
                data += chunk
        return data

    def read_most(self, size: int) -> bytes:
        """At most so many bytes; the rest stays on the line."""
        assert self._far is not None
        with contextlib.suppress(BlockingIOError, OSError):
            return os.read(self._far, size) if size > 0 else b""
        return b""

    def close(self) -> None:
        if self._far is not None:
            self.unplug()

"""A serial device of the host: raw, without flow control, and it may go away and come back.

Nothing here waits. What the line does not take in time is lost whole frame by whole frame and counted, as an autopilot's
own driver does it: a backlog of seconds would make every later message late.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import struct
import termios
import tty
from contextlib import suppress
from glob import glob

from bench.errors import Fault, SetupError
from bench.simspec import DEFAULT_BAUD

from ._frames import FrameReader, sender

# A byte takes ten bits on a line: start, eight bits, stop.
BITS_PER_BYTE = 10
# Chosen: longer than the burst of one step, shorter than any timeout of an autopilot.
BACKLOG_S = 0.1
# Two of the longest frames, for slow lines.
_MIN_BACKLOG_BYTES = 600
_DEVICES = ("/dev/serial/by-id/*", "/dev/ttyACM*", "/dev/ttyUSB*", "/dev/ttyAMA*", "/dev/ttyTHS*")
# termios.tcgetattr: places of control flags and of the two speeds.
_CFLAG, _ISPEED, _OSPEED = 2, 4, 5
_MOST_LOST_AT_ONCE = 128
_COUNT = struct.Struct("i")


def capacity_bps(baud: int) -> float:
    """Bytes a second that a line carries in each direction."""
    return baud / BITS_PER_BYTE


class SerialDevice:
    """One open device. Raises SetupError, which names `field`, when it cannot be opened now.

    With `baud` 0 the line keeps the speed that it has. Later it may vanish (a cable, a board that restarts): it is then
    tried again at each `read` until it is there.
    """

    def __init__(self, path: str, baud: int, field: str) -> None:
        self.path, self.baud = path, baud
        self.lost_bytes = 0
        """Bytes of whole frames that the line did not take."""
        self.resets = 0
        """How often the device went away and came back."""
        speed = getattr(termios, f"B{baud}", None)
        if baud and speed is None:
            raise SetupError(field, f"{baud} baud is no speed of this system", f"give {_speeds()}")
        self._speed: int | None = speed if baud else None
        self._backlog = bytearray()
        self._most_bytes = max(round(capacity_bps(baud or DEFAULT_BAUD) * BACKLOG_S), _MIN_BACKLOG_BYTES)
        self._terminal: int | None = None
        try:
            self._open()
        except (OSError, termios.error) as error:
            raise SetupError(_fault(field, path, error)) from None

    def read(self, size: int) -> bytes:
        """What has come; nothing where nothing has, or where the device is away."""
        if self._terminal is None:
            with suppress(OSError, termios.error):
                self._open()
                self.resets += 1
            return b""
        try:
            data = os.read(self._terminal, size)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop()
        return data

    def send(self, frame: bytes) -> bool:
        """Send a whole frame. False, and nothing of it is sent, where the line is full or the device away."""
        if self._terminal is None or len(self._backlog) + self._queued() > self._most_bytes:
            self.lost_bytes += len(frame)
            return False
        self._backlog += frame
        try:
            while self._backlog:
                del self._backlog[: os.write(self._terminal, self._backlog)]
        except BlockingIOError:
            pass
        except OSError:
            self._drop()
        return True

    def close(self) -> None:
        if self._terminal is not None:
            os.close(self._terminal)
            self._terminal = None

    def _open(self) -> None:
        terminal = os.open(self.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            # Two programs on one line take each other's bytes.
            fcntl.flock(terminal, fcntl.LOCK_EX | fcntl.LOCK_NB)
            tty.setraw(terminal)
            attributes = termios.tcgetattr(terminal)
            attributes[_CFLAG] |= termios.CLOCAL | termios.CREAD
            attributes[_CFLAG] &= ~(termios.CRTSCTS | termios.CSTOPB | termios.PARENB)
            if self._speed is not None:
                attributes[_ISPEED] = attributes[_OSPEED] = self._speed
            termios.tcsetattr(terminal, termios.TCSANOW, attributes)
        except BaseException:
            os.close(terminal)
            raise
        self._terminal = terminal

    def _drop(self) -> None:
        self.lost_bytes += len(self._backlog)
        self._backlog.clear()
        self.close()

    def _queued(self) -> int:
        """Bytes that the system holds for the line."""
        assert self._terminal is not None
        count = bytearray(_COUNT.size)
        try:
            fcntl.ioctl(self._terminal, termios.TIOCOUTQ, count)
        except OSError:
            return 0
        return int(_COUNT.unpack(count)[0])


class SequenceReader(FrameReader):
    """Counts the messages that are missing in what came, by the sequence numbers of each sender."""

    def __init__(self) -> None:
        super().__init__()
        self.lost_messages = 0
        self._sequences: dict[tuple[int, int], int] = {}

    def feed(self, data: bytes, *options: bool | int | None, **named: bool | int | None) -> list[bytes]:
        frames = super().feed(data, *options, **named)  # type: ignore[arg-type]
        for frame in frames:
            source = sender(frame)
            sequence = frame[4] if frame[0] == 0xFD else frame[2]
            previous = self._sequences.get(source, sequence - 1)
            gap = (sequence - previous - 1) & 0xFF
            # More is a sender that began anew, or does not count.
            self.lost_messages += gap if gap < _MOST_LOST_AT_ONCE else 0
            self._sequences[source] = sequence
        return frames

    def forget(self) -> None:
        """Begin anew, as after a reset: senders count from 0 again, and half a frame has no other half."""
        self._sequences.clear()
        self._rest = b""


def serial_devices() -> list[str]:
    """Serial devices that this machine has."""
    return [path for pattern in _DEVICES for path in sorted(glob(pattern))]


def _fault(field: str, path: str, error: Exception) -> Fault:
    number = error.errno if isinstance(error, OSError) else errno.ENOTTY
    if number == errno.ENOENT:
        there = ", ".join(serial_devices())
        none = "this machine has no serial device now: plug it in, see dmesg"
        remedy = f"there are {there}" if there else none
        return Fault(field, f"there is no device {path}", remedy)
    if number in (errno.EACCES, errno.EPERM):
        remedy = "add the user to the group that owns it (ls -l; dialout on Debian), and log in again"
        return Fault(field, f"{path} may not be opened by this user", remedy)
    if number in (errno.EBUSY, errno.EAGAIN):
        remedy = "end the other program, such as a ground station or ModemManager"
        return Fault(field, f"{path} is in use by another program", remedy)
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or not _is_character_device(path):
        remedy = "give a device such as /dev/ttyACM0 or /dev/ttyUSB0"
        return Fault(field, f"{path} is no serial device", remedy)
    return Fault(field, f"{path} cannot be opened: {error}", "see dmesg")


def _is_character_device(path: str) -> bool:
    with suppress(OSError):
        return stat.S_ISCHR(os.stat(path).st_mode)
    return False


def _speeds() -> str:
    known = {int(name[1:]) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
    return ", ".join(str(speed) for speed in sorted(known) if speed >= 57600)

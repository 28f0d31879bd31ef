"""What the kinds of links share: the frames that wait of each client, and counts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable

from bench.contracts import LinkSpec

from ._frames import MAX_FRAME, FrameReader

INBOX_FRAMES = 2048
# A client of whom more than this waits floods the link.
FLOOD_FRAMES = 1536
# So many messages of a client that floods the link are handled in a step.
FLOOD_FRAMES_PER_STEP = 8
MAX_CLIENTS = 8
# Bounds of one socket in one poll; the rest waits for the next.
FRAMES_PER_POLL = 128
GARBAGE_BYTES_PER_POLL = 512
# Bytes of a stream read at once.
_CHUNK_BYTES = 2048
# A chunk never holds more frames: the smallest has 8 bytes.
_CHUNK_FRAMES = (_CHUNK_BYTES + MAX_FRAME) // 8


class Inbox:
    """Frames that wait, a queue for each client, taken in turn: one client's flood delays no other."""

    def __init__(self) -> None:
        self._queues: dict[object, deque[bytes]] = {}
        self._waiting = 0

    def __len__(self) -> int:
        return self._waiting

    def room(self, source: object) -> int:
        """How many more frames of this client it holds."""
        queue = self._queues.get(source)
        if queue is None:
            return INBOX_FRAMES if len(self._queues) < 4 * MAX_CLIENTS else 0
        return INBOX_FRAMES - len(queue)

    def put(self, source: object, frame: bytes) -> bool:
        """False when too much of this client waits, or of too many clients."""
        if not self.room(source):
            return False
        self._queues.setdefault(source, deque()).append(frame)
        self._waiting += 1
        return True

    def take(self, max_frames: int) -> list[bytes]:
        """The oldest frames, one of each client in turn; of a client that floods the link only a few."""
        taken: list[bytes] = []
        remaining = {
            source: FLOOD_FRAMES_PER_STEP
            for source, queue in self._queues.items()
            if len(queue) > FLOOD_FRAMES
        }
        turn = deque(self._queues)
        while turn and len(taken) < max_frames:
            source = turn.popleft()
            queue = self._queues[source]
            taken.append(queue.popleft())
            if source in remaining:
                remaining[source] -= 1
            if not queue:
                del self._queues[source]
            elif remaining.get(source, 1):
                turn.append(source)
        # The next in turn is the first of the next step, or a flood of many clients would starve it.
        if turn:
            served = [source for source in self._queues if source not in turn]
            self._queues = {source: self._queues[source] for source in (*turn, *served)}
        self._waiting -= len(taken)
        return taken

    def clear(self) -> None:
        self._queues.clear()
        self._waiting = 0


class Link(ABC):
    """One opened link; clients open the other end at `endpoint`."""

    endpoint: str

    def __init__(self, spec: LinkSpec) -> None:
        self.spec = spec
        self.inbox = Inbox()
        self.received = 0
        self.sent = 0
        self.silenced = False
        """Whether nothing passes, in either direction."""
        self.garbage_bytes = 0
        self._dropped = 0

    @abstractmethod
    def poll(self) -> None:
        """Move the data that waits in the sockets to the inbox, as whole frames."""

    @abstractmethod
    def send(self, frames: list[bytes]) -> None:
        """Send whole frames to every client of the link."""

    @abstractmethod
    def close(self) -> None: ...

    def connected(self) -> bool:
        """Whether there is a receiver for what is sent now; a line has one always, and what it does not take is lost."""
        return True

    @property
    def dropped(self) -> int:
        """Lost messages; of datagrams that were discarded unread, the number of datagrams."""
        return self._dropped

    def _put_frames(
        self, source: object, reader: FrameReader, data: bytes, most: int | None = None
    ) -> tuple[int, int]:
        """Put whole frames into the inbox; returns counts of frames and of bytes of garbage. `most` is for a
        datagram, of which at most so many frames are taken and nothing is left for the next.
        """
        garbage, unread = reader.garbage_bytes, reader.unread_bytes
        frames = reader.feed(data, most is not None, GARBAGE_BYTES_PER_POLL, most)
        self.received += len(frames)
        for frame in frames:
            # Read all the same: a peer is known, and a stream goes on, only by what it sends.
            if not self.spec.heard or not self.inbox.put(source, frame):
                self._dropped += 1
        self._dropped += reader.unread_bytes > unread
        garbage = reader.garbage_bytes - garbage
        self.garbage_bytes += garbage
        return len(frames), garbage

    def _read_stream(self, source: object, reader: FrameReader, read: Callable[[int], bytes]) -> None:
        """Read a stream within the bounds of one poll. Raises what `read` raises; EOFError at the end."""
        frames = garbage = 0
        while (
            frames < FRAMES_PER_POLL
            and garbage < GARBAGE_BYTES_PER_POLL
            and self.inbox.room(source) >= _CHUNK_FRAMES
        ):
            data = read(_CHUNK_BYTES)
            if not data:
                raise EOFError
            count, bad_bytes = self._put_frames(source, reader, data)
            frames, garbage = frames + count, garbage + bad_bytes

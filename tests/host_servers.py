"""TCP servers of the host, for tests of what a session reaches outside of itself."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

LOCALHOST = "127.0.0.1"


def echo(connection: socket.socket) -> None:
    """Send back what comes, and end when the client has ended."""
    while data := connection.recv(65536):
        connection.sendall(data)
    connection.shutdown(socket.SHUT_WR)


def shout(connection: socket.socket) -> None:
    """Send back what comes in capitals."""
    while data := connection.recv(65536):
        connection.sendall(data.upper())


def answer_page(connection: socket.socket) -> None:
    """Answer one request of HTTP with the text `map`."""
    connection.recv(65536)
    connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\nConnection: close\r\n\r\nmap")


@contextmanager
def server(serve: Callable[[socket.socket], None], address: str = LOCALHOST, port: int = 0) -> Iterator[int]:
    """The port of a server with a thread for each connection; the connections end with the block."""
    connections: list[socket.socket] = []

    def talk(connection: socket.socket) -> None:
        with connection, suppress(OSError):
            serve(connection)

    def accept(listener: socket.socket) -> None:
        with suppress(OSError):
            while True:
                connections.append(listener.accept()[0])
                threading.Thread(target=talk, args=(connections[-1],), daemon=True).start()

    with socket.create_server((address, port)) as listener:
        thread = threading.Thread(target=accept, args=(listener,))
        thread.start()
        try:
            yield int(listener.getsockname()[1])
        finally:
            # Closing alone does not wake the threads that wait for these. The listener first: what it accepts as the block
            # ends is then among the connections.
            with suppress(OSError):
                listener.shutdown(socket.SHUT_RDWR)
            thread.join()
            for connection in connections:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)

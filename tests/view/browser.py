"""Chromium driven over a pipe by the DevTools protocol: pages that fetch, play and scroll need more than `--dump-dom`."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

_CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(_CHROMIUM is None, reason="no Chromium on this machine")
_OPTIONS = (
    "headless no-sandbox disable-gpu disable-quic no-first-run disable-sync disable-background-networking "
    "disable-component-update disable-dev-shm-usage hide-scrollbars no-zygote remote-debugging-pipe"
)
# Host seconds that a page has for what a test waits for, on a busy machine.
_PATIENCE_S = 60.0


class Browser:
    """One page at `address`. `faults` are errors of its scripts and console, `requests` the addresses that it asked for."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers, self._number = commands, answers, 0
        self._left = b""
        self._session: str | None = None
        self._target: str | None = None
        self.faults: list[str] = []
        self.requests: list[str] = []
        self.renew()

    def renew(self) -> None:
        """An empty page in place of the old one, of which nothing is noted any more."""
        old, self._session = self._target, None
        self._target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        if old:
            self.call("Target.closeTarget", targetId=old)
        self.faults.clear()
        self.requests.clear()
        self.address = ""
        self.resize(1440, 900)

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """The result of one command. What happens meanwhile is noted."""
        self._number += 1
        session = {"sessionId": self._session} if self._session else {}
        message = {"id": self._number, "method": method, "params": parameters, **session}
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._number:
            self._note(answer)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._left:
            piece = os.read(self._answers, 1 << 16)
            assert piece, "Chromium has ended"
            self._left += piece
        text, self._left = self._left.split(b"\0", 1)
        answer: dict[str, Any] = json.loads(text)
        return answer

    def _note(self, event: dict[str, Any]) -> None:
        if event.get("sessionId") != self._session:
            return
        parameters = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                self.faults.append(str(parameters["exceptionDetails"].get("exception", parameters)))
            case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning", "assert"):
                self.faults.append(str(parameters["args"]))
            case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                self.faults.append(str(parameters["entry"]))
            case "Network.requestWillBeSent":
                self.requests.append(str(parameters["request"]["url"]))

    def open(self, address: str) -> None:
        """Go to an address; its scripts may still be at work afterwards."""
        self.address = address
        self.call("Page.navigate", url=address)

    def go(self, fragment: str) -> None:
        """Another panel of the same page."""
        self.run(f"location.hash = {json.dumps(fragment)}")

    def run(self, script: str) -> Any:
        """The value of an expression; promises are awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True, userGesture=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str) -> Any:
        """The first value of an expression that is true, looked for at each frame; the test fails where there is none."""
        value = self.run(
            f"new Promise((done, fail) => {{ const end = performance.now() + {1000 * _PATIENCE_S};"
            f"const look = () => {{ let value; try {{ value = ({condition}); }} catch (e) {{}}"
            "if (value) done(value instanceof Node ? true : value); else if (performance.now() > end) done(null); else setTimeout(look, 30); }; look(); })"
        )
        assert value, f"{condition}: {self.run('document.body.innerText')[:2000]}"
        return value

    def press(self, key: str) -> None:
        """One key, as a person presses it."""
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                text=key if len(key) == 1 and kind == "keyDown" else "",
            )

    def click(self, x: float, y: float) -> None:
        """A click at a place of the window."""
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def resize(self, width: int, height: int, *, dark: bool = False) -> None:
        """The size of the window, and the colours that the system asks for."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)

    def picture(self, *, whole: bool = False) -> bytes:
        """What the window shows as PNG; `whole`: the page to its end."""
        answer = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        return base64.b64decode(answer["data"])


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Yield a page of a new Chromium."""
    # Not `tmp_path`: Chromium makes a socket in it, and paths of sockets are short.
    with tempfile.TemporaryDirectory(prefix="chromium-") as folder:
        yield from _opened(folder)


def _opened(folder: str) -> Iterator[Browser]:
    to_read, commands = _pipe()
    answers, to_write = _pipe()
    options = [f"--{option}" for option in _OPTIONS.split()]
    command = [str(_CHROMIUM), *options, f"--user-data-dir={folder}/profile"]
    # Not `subprocess`: a shell or a function between fork and exec would have to place the two files.
    actions = [
        (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
        (os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0),
        (os.POSIX_SPAWN_DUP2, to_read, 3),
        (os.POSIX_SPAWN_DUP2, to_write, 4),
    ]
    # A group of its own: those that it starts write into the folder as long as they live.
    process = os.posix_spawn(
        command[0], command, os.environ | {"TMPDIR": folder}, file_actions=actions, setpgroup=0
    )
    os.close(to_read)
    os.close(to_write)
    try:
        yield Browser(commands, answers)
    finally:
        os.killpg(process, signal.SIGKILL)
        os.waitpid(process, 0)
        os.close(commands)
        os.close(answers)


def _pipe() -> tuple[int, int]:
    """A pipe whose ends are no files 3 and 4, which Chromium reads and writes."""
    ends = os.pipe()
    higher = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends]
    for end in ends:
        os.close(end)
    return higher[0], higher[1]

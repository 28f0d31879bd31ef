"""The command `rebar`. Every command is a few lines over functions of other packages.

Exit codes: 0 done, 1 failed, 2 wrong usage or input, 130 interrupted. A mistake of the user never prints a
traceback.
"""

from __future__ import annotations

import os
import sys
from collections.abc import MutableMapping

LOOPBACK = ("localhost", "127.0.0.1", "::1")


def main() -> None:
    """The console script."""
    if sys.getfilesystemencoding() != "utf-8":
        _restart_in_utf8()
    from bench.visible_text import visible_output

    from ._app import run

    exempt_loopback(os.environ)
    with visible_output():
        try:
            code = run(sys.argv[1:])
        # A fault of the bench. Its traceback may hold the words of others.
        except Exception:
            sys.excepthook(*sys.exc_info())
            code = 1
    sys.exit(code)


def _restart_in_utf8() -> None:
    """Begin again with Python's UTF-8 mode, for workers too: the names of files stand in documents, and libraries that
    open them take UTF-8. What is printed stays in the encoding of the locale.
    """
    os.environ["PYTHONUTF8"] = "1"
    if sys.stdout is not None:
        os.environ.setdefault("PYTHONIOENCODING", sys.stdout.encoding)
    os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])


def exempt_loopback(environment: MutableMapping[str, str]) -> None:
    """Add this machine to the hosts that are reached without a proxy: no proxy leads back to it. Workers inherit it.

    Many libraries ask the environment for proxies: for object stores, for MQTT, for language models.
    """
    if not any(name.lower().endswith("_proxy") for name in environment):
        return
    stated = environment.get("no_proxy") or environment.get("NO_PROXY", "")
    # Alone it exempts every host; in a list, not for all libraries.
    if stated.strip() == "*":
        return
    hosts = [host.strip() for host in stated.split(",") if host.strip()]
    hosts += [host for host in LOOPBACK if host not in hosts]
    # Libraries differ in which spelling they look for first.
    environment["no_proxy"] = environment["NO_PROXY"] = ",".join(hosts)

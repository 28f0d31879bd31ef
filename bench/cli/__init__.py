"""The command `rebar`. Every command is a few lines over functions of other packages.

Exit codes: 0 done, 1 failed, 2 wrong usage or input, 130 interrupted. A mistake of the user never prints a
traceback.
"""

from __future__ import annotations

import os
import sys


def main() -> None:
    """The console script."""
    if sys.getfilesystemencoding() != "utf-8":
        _restart_in_utf8()
    from bench.visible_text import visible_output

    from ._app import run
    from ._proxies import exempt_loopback

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

"""The command `rebar`. Every command is a few lines over functions of other packages.

Exit codes: 0 done, 1 failed, 2 wrong usage or input, 130 interrupted. A mistake of the user never prints a
traceback.
"""

from __future__ import annotations

import sys


def main() -> None:
    """The console script."""
    from bench.visible_text import visible_output

    from ._app import run

    with visible_output():
        try:
            code = run(sys.argv[1:])
        # A fault of the bench. Its traceback may hold the words of others.
        except Exception:
            sys.excepthook(*sys.exc_info())
            code = 1
    sys.exit(code)

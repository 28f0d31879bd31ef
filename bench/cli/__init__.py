"""The command `rebar`. Every command is a few lines over functions of other packages.

Exit codes: 0 done, 1 failed, 2 wrong usage or input, 130 interrupted. A mistake of the user never prints a
traceback.
"""

from __future__ import annotations

import sys


def main() -> None:
    """The console script."""
    from ._app import run

    sys.exit(run(sys.argv[1:]))

"""The command `rebar`: thin, every command a few lines over a room's face.

Exit codes: 0 done, 1 the thing asked about failed, 2 usage or input. A user's mistake is never a traceback.
"""

from __future__ import annotations

import sys


def main() -> None:
    """The console script."""
    from ._app import run

    sys.exit(run(sys.argv[1:]))

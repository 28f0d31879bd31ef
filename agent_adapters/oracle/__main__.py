"""`python -m agent_adapters.oracle`, started by the bench from a manifest with `truth: true`."""

from __future__ import annotations

import os
import sys

from agent_adapters.client import end_process, read_environment, use_one_thread
from bench.errors import LinkLost, SetupError


def main() -> int:
    """0 when the session ended in order, 1 when the bench was lost, 2 when the agent was started wrongly."""
    use_one_thread()
    # Only now: NumPy starts its threads when it is imported.
    from ..reference.mission._mission import MissionOrderMissing
    from ._agent import run

    try:
        ended = run(read_environment(os.environ), os.environ.get("REBAR_TRUTH", ""))
    except SetupError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except (LinkLost, MissionOrderMissing) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stderr.write(f"{ended}\n")
    return 0


if __name__ == "__main__":
    end_process(main())

"""`python -m agent_adapters.oracle`, started by the bench from a manifest with `truth: true`."""

from __future__ import annotations

import os

from agent_adapters.client import end_process, exit_code, read_environment, use_one_thread


def main() -> int:
    """The exit code."""
    use_one_thread()
    # Only now: NumPy starts its threads when it is imported.
    from ._agent import run

    return exit_code(lambda: run(read_environment(os.environ), os.environ.get("REBAR_TRUTH", "")))


if __name__ == "__main__":
    end_process(main())

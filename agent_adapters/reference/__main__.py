"""`python -m agent_adapters.reference --policy naive|bystander_aware`, started from a manifest."""

from __future__ import annotations

import argparse
import os
from typing import get_args

from agent_adapters.client import end_process, exit_code, read_environment, use_one_thread

from ._settings import Eyes, PolicyName


def main() -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m agent_adapters.reference", description="The reference search-and-report agent."
    )
    parser.add_argument(
        "--policy", choices=get_args(PolicyName), required=True, help="whether it thinks of bystanders"
    )
    parser.add_argument(
        "--eyes",
        choices=get_args(Eyes),
        default="detections",
        help="what it sees with: the bench's detections, or a detector of its own on the pictures",
    )
    arguments = parser.parse_args()
    use_one_thread()
    # Only now: NumPy starts its threads when it is imported.
    from ._agent import run

    return exit_code(lambda: run(read_environment(os.environ), arguments.policy, arguments.eyes))


if __name__ == "__main__":
    end_process(main())

"""`python -m bench.cli`, the same as `rebar`."""

from __future__ import annotations

from . import main

main()

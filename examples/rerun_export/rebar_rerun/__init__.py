"""Recordings of the bench in the viewer of Rerun: the command `rebar export-rerun`, from outside."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._export import export_for_rerun as export_for_rerun

# `rebar --help` imports the command: it shall not wait for Rerun.
__getattr__ = lazy_names(__name__)

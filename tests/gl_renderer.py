"""The outside renderer of examples/gl_renderer, imported where it lies."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench.contracts import plugins

sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "gl_renderer"))

from rebar_gl import open_moderngl_renderer as open_moderngl_renderer

PACKAGE = Path(__file__).parents[1] / "examples" / "gl_renderer"

needs_gl = pytest.mark.skipif(
    bool(open_moderngl_renderer.host_faults()), reason="needs the package moderngl and a driver for EGL"
)


def declare(monkeypatch: pytest.MonkeyPatch) -> None:
    """For one test, `moderngl` is a renderer as if the package were installed."""
    entry = EntryPoint("moderngl", "rebar_gl:open_moderngl_renderer", "rebar.renderers")
    monkeypatch.setitem(plugins("rebar.renderers"), "moderngl", entry)

"""The entry point `moderngl` of group `rebar.renderers`, and what it says where there is no OpenGL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.contracts import Renderer, Stage
from bench.errors import Fault, SetupError

from ._renderer import ModernGlRenderer

_LEAST_VERSION = 430
"""OpenGL 4.3 has indirect draws of many actors at once. Mesa's software renderer and every GPU since 2012 have it."""

_OTHERWISE = "leave the field out, and opencv draws"


class _OpenModernGl:
    """Callable as `OpenRenderer`, and a `ChecksHost`."""

    def __call__(self, stage: Stage) -> Renderer:
        return ModernGlRenderer(stage, _context())

    def host_faults(self) -> Sequence[Fault]:
        try:
            _context().release()
        except SetupError as error:
            return error.faults
        return []


def _context() -> Any:
    """A new OpenGL context without a window. Raises SetupError where there is none."""
    try:
        import moderngl
    except ImportError as error:
        raise SetupError(
            Fault(
                "renderer moderngl",
                f"the package {error.name} is not installed",
                f"pip install moderngl, or {_OTHERWISE}",
            )
        ) from error
    try:
        context = moderngl.create_standalone_context(backend="egl", require=_LEAST_VERSION)
    # glcontext and moderngl raise bare Exceptions, whatever is missing: the library, a device or the version.
    except Exception as error:
        raise SetupError(
            Fault(
                "renderer moderngl",
                f"OpenGL {_LEAST_VERSION / 100:.1f} cannot be opened through EGL ({str(error).splitlines()[0]})",
                "install a driver (Debian, on the CPU: apt install libegl1 libegl-mesa0 libgl1-mesa-dri), or "
                f"{_OTHERWISE}",
            )
        ) from error
    return context


open_moderngl_renderer = _OpenModernGl()

"""The renderer `moderngl`: OpenGL through EGL, with true occlusion and shadows on objects.

Importing it imports neither moderngl nor a driver; opening a renderer does.
"""

from __future__ import annotations

from ._open import open_moderngl_renderer as open_moderngl_renderer

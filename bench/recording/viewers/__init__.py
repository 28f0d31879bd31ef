"""A recording made into a file that Lichtblick and Foxglove show without any set-up.

from bench.recording.viewers import export_for_viewers
export_for_viewers("run/recording.mcap", "run/viewer.mcap")
"""

from __future__ import annotations

from ._export import ExportResult as ExportResult
from ._export import export_for_viewers as export_for_viewers

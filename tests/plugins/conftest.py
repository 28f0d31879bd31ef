from __future__ import annotations

from installed_packages import site as site

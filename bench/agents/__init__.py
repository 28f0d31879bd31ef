"""How an agent under test is started, connected, bounded and ended.

Only the air network crosses from here to an agent.
"""

from __future__ import annotations

from ._cache import FilledCache as FilledCache
from ._cache import cache_faults as cache_faults
from ._cache import open_cache as open_cache
from ._manifest import installed_agents as installed_agents
from ._manifest import load_manifest as load_manifest
from ._process import LocalProcess as LocalProcess
from ._process import open_agent as open_agent
from ._program import program_faults as program_faults
from .confinement import rung_of as rung_of

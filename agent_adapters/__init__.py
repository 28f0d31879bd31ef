"""How an agent under test is started, connected, paced and confined; the reference agents; the client library.

Only the air network crosses from here to an agent. `agent_adapters.client` is what a Python agent may use on its side;
`agent_adapters.reference` is an agent like any other.
"""

from __future__ import annotations

from ._manifest import load_manifest as load_manifest
from ._process import LocalProcess as LocalProcess
from ._process import open_agent as open_agent

"""How much of the host an agent can reach: a ladder of ways to confine it, behind one contract."""

from __future__ import annotations

from ._box import AGENT_UID as AGENT_UID
from ._box import BOX_PLACE as BOX_PLACE
from ._box import Box as Box
from ._box import Place as Place
from ._box import agent_user as agent_user
from ._ladder import CONTAINER as CONTAINER
from ._ladder import rung_of as rung_of
from ._ladder import rungs as rungs
from ._readable_paths import find_program as find_program
from ._readable_paths import program_paths as program_paths
from ._readable_paths import without_sessions as without_sessions
from ._rung import ConfinedProcess as ConfinedProcess
from ._rung import Rung as Rung
from ._walls import HOLDINGS as HOLDINGS
from ._walls import Host as Host
from ._walls import Wall as Wall
from ._walls import leaves_open as leaves_open
from ._walls import this_host as this_host
from ._walls import wall_name as wall_name
from ._walls import wall_text as wall_text
from ._walls import walls_table as walls_table

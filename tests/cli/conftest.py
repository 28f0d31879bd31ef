from __future__ import annotations

import sys
from pathlib import Path

from command_line import rebar as rebar

# For modules beside the tests of other rooms: made campaigns, and views of a camera.
sys.path[:0] = [str(Path(__file__).parents[1] / room) for room in ("reporting", "perception")]

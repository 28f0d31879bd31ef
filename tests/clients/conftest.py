from __future__ import annotations

from client_programs import flown as flown

"""One session: clock, world, scene, lifecycle."""

from __future__ import annotations

from ._air_topics import air_topics as air_topics
from ._camera import PinholeCamera as PinholeCamera
from ._forfeit import open_forfeit as open_forfeit
from ._host_clock import HostClock as HostClock
from ._host_resources import count_memory_kills as count_memory_kills
from ._interface import interface_address as interface_address
from ._scene import open_plain_scene as open_plain_scene
from ._session import Session as Session
from ._session import run_session as run_session
from ._session_faults import camera_faults as camera_faults
from ._session_faults import renderer_faults as renderer_faults
from ._session_faults import session_faults as session_faults
from ._session_parts import SessionPlan as SessionPlan
from ._standalone import DEFAULT_LINKS as DEFAULT_LINKS
from ._standalone import StandalonePlan as StandalonePlan
from ._standalone import fly as fly
from ._standalone import interface_links as interface_links
from ._standalone import run_standalone as run_standalone
from ._standalone import standalone_simspec as standalone_simspec

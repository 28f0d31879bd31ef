"""The SimSpec: one situation as a document, read and written with every fault reported at once.

from bench.simspec import load_simspec
spec = load_simspec("examples/search.yaml")
print(spec.mission.time_limit_s)
"""

from __future__ import annotations

from pathlib import Path

from bench.documents import Document as Document
from bench.documents import load_document
from bench.errors import Fault, SetupError

from ._assets import ASSETS as ASSETS
from ._assets import Asset as Asset
from ._document import ActorGroup as ActorGroup
from ._document import AgentSpec as AgentSpec
from ._document import Along as Along
from ._document import Battery as Battery
from ._document import Bearing as Bearing
from ._document import Budgets as Budgets
from ._document import Camera as Camera
from ._document import CountRange as CountRange
from ._document import DetectionModel as DetectionModel
from ._document import Distance as Distance
from ._document import Environment as Environment
from ._document import Facing as Facing
from ._document import Failure as Failure
from ._document import Fraction as Fraction
from ._document import Gps as Gps
from ._document import Home as Home
from ._document import Identifier as Identifier
from ._document import Intelligence as Intelligence
from ._document import MeanDistance as MeanDistance
from ._document import Mission as Mission
from ._document import Motion as Motion
from ._document import Near as Near
from ._document import NoFlyArea as NoFlyArea
from ._document import Order as Order
from ._document import OrderKind as OrderKind
from ._document import Origin as Origin
from ._document import Outage as Outage
from ._document import Pace as Pace
from ._document import Perception as Perception
from ._document import PlacedActor as PlacedActor
from ._document import PlacedReport as PlacedReport
from ._document import Placement as Placement
from ._document import Point as Point
from ._document import Polygon as Polygon
from ._document import Realized as Realized
from ._document import Road as Road
from ._document import Role as Role
from ._document import Rules as Rules
from ._document import Seeds as Seeds
from ._document import Seen as Seen
from ._document import Sight as Sight
from ._document import SimSpec as SimSpec
from ._document import TimeWindow as TimeWindow
from ._document import VehicleSpec as VehicleSpec
from ._document import Wind as Wind
from ._document import World as World
from ._factor_paths import factor_paths as factor_paths
from ._factors import FACTORS as FACTORS
from ._factors import Factor as Factor
from ._factors import factor_values as factor_values
from ._seeds import Stream as Stream
from ._seeds import generator as generator
from ._seeds import seed_of as seed_of
from ._sun import Sun as Sun
from ._sun import sun_at as sun_at
from ._sun import sun_of as sun_of


def load_simspec(path: Path | str) -> SimSpec:
    """Read a SimSpec from YAML or JSON. Raises SetupError with every fault: file, line, field, mend."""
    spec = load_document(path, SimSpec)
    unknown = [
        Fault(f"{path}: actors[{index}].asset", f"there is no asset {group.asset!r}", f"the catalogue has {', '.join(ASSETS)}")
        for index, group in enumerate(spec.actors)
        if group.asset not in ASSETS
    ]
    if unknown:
        raise SetupError(unknown)
    return spec

"""The SimSpec: one situation as a document. Reading one reports every fault at once.

from bench.simspec import load_simspec
spec = load_simspec("examples/search.yaml")
print(spec.mission.time_limit_s)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._actors import ActorGroup as ActorGroup
    from ._actors import Color as Color
    from ._actors import CountRange as CountRange
    from ._actors import Motion as Motion
    from ._assets import ASSETS as ASSETS
    from ._assets import CLASS_LABELS as CLASS_LABELS
    from ._assets import Asset as Asset
    from ._assets import AssetTable as AssetTable
    from ._assets import asset_fault as asset_fault
    from ._document import AgentSpec as AgentSpec
    from ._document import Budgets as Budgets
    from ._document import Consent as Consent
    from ._document import Escort as Escort
    from ._document import Intelligence as Intelligence
    from ._document import Isolation as Isolation
    from ._document import Mission as Mission
    from ._document import Pace as Pace
    from ._document import PaceMode as PaceMode
    from ._document import PlacedActor as PlacedActor
    from ._document import PlacedReport as PlacedReport
    from ._document import Realized as Realized
    from ._document import Seeds as Seeds
    from ._document import SimSpec as SimSpec
    from ._document import agent_name as agent_name
    from ._document import is_manifest_file as is_manifest_file
    from ._document import load_simspec as load_simspec
    from ._factor_paths import factor_paths as factor_paths
    from ._factors import FACTORS as FACTORS
    from ._factors import FactorDefinition as FactorDefinition
    from ._factors import factor_values as factor_values
    from ._faults import FAILURES as FAILURES
    from ._faults import OUTAGES as OUTAGES
    from ._faults import Failure as Failure
    from ._faults import FailureKind as FailureKind
    from ._faults import Outage as Outage
    from ._faults import OutageKind as OutageKind
    from ._ground import MAX_LATITUDE_DEG as MAX_LATITUDE_DEG
    from ._ground import Area as Area
    from ._ground import Home as Home
    from ._ground import Origin as Origin
    from ._ground import Point as Point
    from ._ground import Polygon as Polygon
    from ._ground import Road as Road
    from ._ground import World as World
    from ._looks import MAX_CORNERS as MAX_CORNERS
    from ._looks import AssetLook as AssetLook
    from ._looks import Panels as Panels
    from ._looks import Solid as Solid
    from ._looks import Triple as Triple
    from ._orders import ENDING_ORDERS as ENDING_ORDERS
    from ._orders import MOTION_ORDERS as MOTION_ORDERS
    from ._orders import PAUSES as PAUSES
    from ._orders import REPORT_ORDERS as REPORT_ORDERS
    from ._orders import SILENCING_ORDERS as SILENCING_ORDERS
    from ._orders import Order as Order
    from ._perception import DUST_EXTINCTION_PER_M as DUST_EXTINCTION_PER_M
    from ._perception import FALSE_SCORE_MEAN as FALSE_SCORE_MEAN
    from ._perception import LEAST_CONTRAST_DEPTH as LEAST_CONTRAST_DEPTH
    from ._perception import DetectionModel as DetectionModel
    from ._perception import Perception as Perception
    from ._perception import PerceptionSource as PerceptionSource
    from ._perception import ScoreQuantiles as ScoreQuantiles
    from ._perception import SizePoint as SizePoint
    from ._placement import HOME as HOME
    from ._placement import Along as Along
    from ._placement import AreaCount as AreaCount
    from ._placement import Avoid as Avoid
    from ._placement import Bearing as Bearing
    from ._placement import Between as Between
    from ._placement import Distance as Distance
    from ._placement import Facing as Facing
    from ._placement import Inside as Inside
    from ._placement import MeanDistance as MeanDistance
    from ._placement import Near as Near
    from ._placement import Placement as Placement
    from ._placement import PlaceReference as PlaceReference
    from ._placement import Sight as Sight
    from ._quantities import Fraction as Fraction
    from ._quantities import Identifier as Identifier
    from ._quantities import TimeWindow as TimeWindow
    from ._roles import PROTECTED_ROLES as PROTECTED_ROLES
    from ._roles import TARGET_ROLES as TARGET_ROLES
    from ._roles import Role as Role
    from ._roles import endangered_roles as endangered_roles
    from ._rules import NoFlyArea as NoFlyArea
    from ._rules import Rules as Rules
    from ._seeds import RandomStream as RandomStream
    from ._seeds import generator as generator
    from ._seeds import seed_of as seed_of
    from ._services import OutsideAir as OutsideAir
    from ._services import OutsideService as OutsideService
    from ._sun import Sun as Sun
    from ._sun import sun_at as sun_at
    from ._sun import sun_of as sun_of
    from ._vehicle_spec import DEFAULT_BAUD as DEFAULT_BAUD
    from ._vehicle_spec import DEFAULT_RENDERER as DEFAULT_RENDERER
    from ._vehicle_spec import DEFAULT_VEHICLE as DEFAULT_VEHICLE
    from ._vehicle_spec import Battery as Battery
    from ._vehicle_spec import Camera as Camera
    from ._vehicle_spec import Distortion as Distortion
    from ._vehicle_spec import Gps as Gps
    from ._vehicle_spec import OutsideLink as OutsideLink
    from ._vehicle_spec import PluginAutopilot as PluginAutopilot
    from ._vehicle_spec import RealAutopilot as RealAutopilot
    from ._vehicle_spec import VehicleSpec as VehicleSpec
    from ._weather import Environment as Environment
    from ._weather import Wind as Wind
    from ._words import IDENTIFIER as IDENTIFIER
    from ._words import OrderKind as OrderKind

__getattr__ = lazy_names(__name__)

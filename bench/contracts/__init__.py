"""What a plug-in promises, and the values that cross the walls of the bench.

A vehicle, a scene, an agent, a measure or a surrogate is a protocol of this package and a line in
pyproject.toml, nothing else.
"""

from __future__ import annotations

from bench.clock import CLOCK as CLOCK
from bench.clock import START as START
from bench.clock import SimTime as SimTime

from ._agent import AgentEndpoints as AgentEndpoints
from ._agent import AgentManifest as AgentManifest
from ._agent import AgentPlan as AgentPlan
from ._agent import AgentProcess as AgentProcess
from ._agent import MavlinkNeed as MavlinkNeed
from ._agent import OpenAgent as OpenAgent
from ._cast import cast_of as cast_of
from ._cast import realized_of as realized_of
from ._detection import FALSE_SCORE as FALSE_SCORE
from ._detection import LABEL_EVIDENCE as LABEL_EVIDENCE
from ._detection import LEAST_DOUBT as LEAST_DOUBT
from ._detection import THRESHOLD_CONTRAST as THRESHOLD_CONTRAST
from ._detection import light_of as light_of
from ._documents import AgentStatus as AgentStatus
from ._documents import AgentTrack as AgentTrack
from ._documents import AgentTracks as AgentTracks
from ._documents import CastDocument as CastDocument
from ._documents import CastMember as CastMember
from ._documents import ConsentAnswer as ConsentAnswer
from ._documents import ConsentRequest as ConsentRequest
from ._documents import Decision as Decision
from ._documents import EventDocument as EventDocument
from ._documents import IntelligenceDocument as IntelligenceDocument
from ._documents import MissionOrder as MissionOrder
from ._documents import NoFlyDocument as NoFlyDocument
from ._documents import OperatorLinkDocument as OperatorLinkDocument
from ._documents import OrderAnswer as OrderAnswer
from ._documents import OrderDocument as OrderDocument
from ._documents import SightingDocument as SightingDocument
from ._documents import TargetReport as TargetReport
from ._documents import VehicleDocument as VehicleDocument
from ._documents import ViewDocument as ViewDocument
from ._documents import parse_document as parse_document
from ._measure import ChecksOptions as ChecksOptions
from ._measure import Measure as Measure
from ._measure import Option as Option
from ._measure import Tape as Tape
from ._measure import Timed as Timed
from ._outcome import Evidence as Evidence
from ._outcome import Observation as Observation
from ._outcome import Outcome as Outcome
from ._outcome import SessionFailure as SessionFailure
from ._outcome import SessionResult as SessionResult
from ._outcome import traceback_details as traceback_details
from ._plugins import PluginGroup as PluginGroup
from ._plugins import load_plugin as load_plugin
from ._plugins import plugins as plugins
from ._record import Record as Record
from ._record import Tap as Tap
from ._scene import CameraFrame as CameraFrame
from ._scene import Detection as Detection
from ._scene import DetectionFrame as DetectionFrame
from ._scene import Detector as Detector
from ._scene import OpenScene as OpenScene
from ._scene import Scene as Scene
from ._scene import Sighting as Sighting
from ._surrogate import MeasureRequest as MeasureRequest
from ._surrogate import Prediction as Prediction
from ._surrogate import Surrogate as Surrogate
from ._tick import MAX_LINE_BYTES as MAX_LINE_BYTES
from ._tick import Ack as Ack
from ._tick import End as End
from ._tick import Hello as Hello
from ._tick import Tick as Tick
from ._tick import TickMessage as TickMessage
from ._tick import read_line as read_line
from ._tick import write_line as write_line
from ._topics import SESSION_EVENTS as SESSION_EVENTS
from ._topics import TF as TF
from ._topics import TF_STATIC as TF_STATIC
from ._topics import TRUTH_ACTORS as TRUTH_ACTORS
from ._topics import TRUTH_CAST as TRUTH_CAST
from ._topics import TRUTH_ODOMETRY as TRUTH_ODOMETRY
from ._topics import TRUTH_VEHICLE as TRUTH_VEHICLE
from ._topics import TRUTH_VIEW as TRUTH_VIEW
from ._topics import VehicleTopics as VehicleTopics
from ._topics import mavlink_topic as mavlink_topic
from ._vehicle import CarriesCamera as CarriesCamera
from ._vehicle import LinkSpec as LinkSpec
from ._vehicle import MavlinkTap as MavlinkTap
from ._vehicle import OpenVehicle as OpenVehicle
from ._vehicle import Vector as Vector
from ._vehicle import Vehicle as Vehicle
from ._vehicle import VehicleCondition as VehicleCondition
from ._vehicle import VehiclePlan as VehiclePlan
from ._vehicle import VehicleState as VehicleState

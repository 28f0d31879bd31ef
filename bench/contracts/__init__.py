"""What a plug-in promises, and the values that cross the walls of the bench.

A vehicle, a scene, an agent, a measure, a surrogate, a renderer or a detector is a protocol of this package and a
line in pyproject.toml, nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.clock import CLOCK as CLOCK
from bench.clock import START as START
from bench.clock import SimTime as SimTime
from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._agent import AgentEndpoints as AgentEndpoints
    from ._agent import AgentLimits as AgentLimits
    from ._agent import AgentManifest as AgentManifest
    from ._agent import AgentPlan as AgentPlan
    from ._agent import AgentProcess as AgentProcess
    from ._agent import AgentRole as AgentRole
    from ._agent import AgentUsage as AgentUsage
    from ._agent import HasProcessRoot as HasProcessRoot
    from ._agent import MavlinkNeed as MavlinkNeed
    from ._agent import OpenAgent as OpenAgent
    from ._agent import ProcessRoot as ProcessRoot
    from ._agent import WarpAccess as WarpAccess
    from ._cast import cast_of as cast_of
    from ._convoy import convoy_places_m as convoy_places_m
    from ._detection import FALSE_SCORE as FALSE_SCORE
    from ._detection import LABEL_EVIDENCE as LABEL_EVIDENCE
    from ._detection import LEAST_DOUBT as LEAST_DOUBT
    from ._detection import THRESHOLD_CONTRAST as THRESHOLD_CONTRAST
    from ._detection import light_of as light_of
    from ._documents import AgentStatus as AgentStatus
    from ._documents import AgentTrack as AgentTrack
    from ._documents import AgentTracks as AgentTracks
    from ._documents import ConsentAnswer as ConsentAnswer
    from ._documents import ConsentRequest as ConsentRequest
    from ._documents import Decision as Decision
    from ._documents import EscortDocument as EscortDocument
    from ._documents import IntelligenceDocument as IntelligenceDocument
    from ._documents import MissionOrder as MissionOrder
    from ._documents import NoFlyDocument as NoFlyDocument
    from ._documents import OperatorLinkDocument as OperatorLinkDocument
    from ._documents import OrderAnswer as OrderAnswer
    from ._documents import OrderDocument as OrderDocument
    from ._documents import TargetReport as TargetReport
    from ._documents import parse_document as parse_document
    from ._escort import escort_document as escort_document
    from ._facts import AgentExit as AgentExit
    from ._facts import AgentStart as AgentStart
    from ._facts import AnyFact as AnyFact
    from ._facts import Arithmetic as Arithmetic
    from ._facts import BenchTraceback as BenchTraceback
    from ._facts import Confinement as Confinement
    from ._facts import Fact as Fact
    from ._facts import FirmwareBuild as FirmwareBuild
    from ._facts import FirmwareEnds as FirmwareEnds
    from ._facts import OverheadFidelity as OverheadFidelity
    from ._facts import PixelDetectorBuild as PixelDetectorBuild
    from ._facts import ServicesLetIn as ServicesLetIn
    from ._facts import ServiceUse as ServiceUse
    from ._facts import StepTiming as StepTiming
    from ._facts import SuspectEnds as SuspectEnds
    from ._facts import Texts as Texts
    from ._facts import TruthGiven as TruthGiven
    from ._facts import TruthSightings as TruthSightings
    from ._facts import WarpLibrary as WarpLibrary
    from ._facts import fact_of as fact_of
    from ._facts import facts_of as facts_of
    from ._measure import ChecksOptions as ChecksOptions
    from ._measure import Measure as Measure
    from ._measure import Option as Option
    from ._measure import Tape as Tape
    from ._measure import Timed as Timed
    from ._measure import detections_by_frame as detections_by_frame
    from ._mqtt_documents import MavlinkJson as MavlinkJson
    from ._mqtt_documents import MqttAck as MqttAck
    from ._mqtt_documents import MqttEnd as MqttEnd
    from ._mqtt_documents import MqttReady as MqttReady
    from ._mqtt_documents import MqttTick as MqttTick
    from ._outcome import FIRMWARE_FAILED as FIRMWARE_FAILED
    from ._outcome import PROBES as PROBES
    from ._outcome import Blame as Blame
    from ._outcome import Evidence as Evidence
    from ._outcome import Observation as Observation
    from ._outcome import Outcome as Outcome
    from ._outcome import SessionFailure as SessionFailure
    from ._outcome import SessionResult as SessionResult
    from ._outcome import losses_of as losses_of
    from ._outcome import probes_of as probes_of
    from ._plugins import PluginGroup as PluginGroup
    from ._plugins import failure_text as failure_text
    from ._plugins import load_plugin as load_plugin
    from ._plugins import package_of as package_of
    from ._plugins import plugins as plugins
    from ._progress import OnProgress as OnProgress
    from ._progress import ProgressUpdate as ProgressUpdate
    from ._progress import ignore_progress as ignore_progress
    from ._realized import realized_of as realized_of
    from ._record import Record as Record
    from ._record import Tap as Tap
    from ._rendering import NO_DISTORTION as NO_DISTORTION
    from ._rendering import CameraPose as CameraPose
    from ._rendering import ChecksHost as ChecksHost
    from ._rendering import Geometry as Geometry
    from ._rendering import Ground as Ground
    from ._rendering import Labels as Labels
    from ._rendering import Lens as Lens
    from ._rendering import Light as Light
    from ._rendering import Look as Look
    from ._rendering import NamesBuild as NamesBuild
    from ._rendering import OpenRenderer as OpenRenderer
    from ._rendering import Picture as Picture
    from ._rendering import Pixels as Pixels
    from ._rendering import Renderer as Renderer
    from ._rendering import Stage as Stage
    from ._rendering import distortion_faults as distortion_faults
    from ._rendering import lens_of as lens_of
    from ._scene import CameraFrame as CameraFrame
    from ._scene import CameraPicture as CameraPicture
    from ._scene import Detection as Detection
    from ._scene import DetectionFrame as DetectionFrame
    from ._scene import Detector as Detector
    from ._scene import ObservesCameras as ObservesCameras
    from ._scene import OpenPixelDetector as OpenPixelDetector
    from ._scene import OpenScene as OpenScene
    from ._scene import PixelDetector as PixelDetector
    from ._scene import Scene as Scene
    from ._scene import Sighting as Sighting
    from ._scene import VersionedDetector as VersionedDetector
    from ._surrogate import MeasureRequest as MeasureRequest
    from ._surrogate import Prediction as Prediction
    from ._surrogate import Surrogate as Surrogate
    from ._tick import MAX_LINE_BYTES as MAX_LINE_BYTES
    from ._tick import Ack as Ack
    from ._tick import End as End
    from ._tick import Hello as Hello
    from ._tick import Tick as Tick
    from ._tick import TickMessage as TickMessage
    from ._tick import line_fault as line_fault
    from ._tick import read_line as read_line
    from ._tick import write_line as write_line
    from ._topics import CAMERA_OPENED as CAMERA_OPENED
    from ._topics import DETECTOR_OPENED as DETECTOR_OPENED
    from ._topics import FIRMWARE_BOOTED as FIRMWARE_BOOTED
    from ._topics import OPERATOR_GIVES_BACK as OPERATOR_GIVES_BACK
    from ._topics import OPERATOR_LINK as OPERATOR_LINK
    from ._topics import OPERATOR_TAKES as OPERATOR_TAKES
    from ._topics import SESSION_EVENTS as SESSION_EVENTS
    from ._topics import TF as TF
    from ._topics import TF_STATIC as TF_STATIC
    from ._topics import TRUTH_ACTORS as TRUTH_ACTORS
    from ._topics import TRUTH_CAST as TRUTH_CAST
    from ._topics import TRUTH_ODOMETRY as TRUTH_ODOMETRY
    from ._topics import TRUTH_PICTURES as TRUTH_PICTURES
    from ._topics import TRUTH_VEHICLE as TRUTH_VEHICLE
    from ._topics import TRUTH_VIEW as TRUTH_VIEW
    from ._topics import VehicleTopics as VehicleTopics
    from ._topics import is_mavlink_from_agent as is_mavlink_from_agent
    from ._topics import mavlink_topic as mavlink_topic
    from ._topics import truth_depth_topic as truth_depth_topic
    from ._topics import truth_mask_topic as truth_mask_topic
    from ._truth_documents import ActorPixelsDocument as ActorPixelsDocument
    from ._truth_documents import CastDocument as CastDocument
    from ._truth_documents import CastMember as CastMember
    from ._truth_documents import EventDocument as EventDocument
    from ._truth_documents import PictureDocument as PictureDocument
    from ._truth_documents import SightingDocument as SightingDocument
    from ._truth_documents import TruthDocument as TruthDocument
    from ._truth_documents import VehicleDocument as VehicleDocument
    from ._truth_documents import ViewDocument as ViewDocument
    from ._vehicle import BootsFirmware as BootsFirmware
    from ._vehicle import CarriesCamera as CarriesCamera
    from ._vehicle import LinkSpec as LinkSpec
    from ._vehicle import MavlinkTap as MavlinkTap
    from ._vehicle import OpenVehicle as OpenVehicle
    from ._vehicle import Vector as Vector
    from ._vehicle import Vehicle as Vehicle
    from ._vehicle import VehicleCondition as VehicleCondition
    from ._vehicle import VehiclePlan as VehiclePlan
    from ._vehicle import VehicleState as VehicleState

_MODULES = {
    "AgentEndpoints": "_agent",
    "AgentLimits": "_agent",
    "AgentManifest": "_agent",
    "AgentRole": "_agent",
    "AgentPlan": "_agent",
    "AgentProcess": "_agent",
    "AgentUsage": "_agent",
    "HasProcessRoot": "_agent",
    "MavlinkNeed": "_agent",
    "OpenAgent": "_agent",
    "ProcessRoot": "_agent",
    "WarpAccess": "_agent",
    "cast_of": "_cast",
    "convoy_places_m": "_convoy",
    "FALSE_SCORE": "_detection",
    "LABEL_EVIDENCE": "_detection",
    "LEAST_DOUBT": "_detection",
    "THRESHOLD_CONTRAST": "_detection",
    "light_of": "_detection",
    "ActorPixelsDocument": "_truth_documents",
    "AgentStatus": "_documents",
    "AgentTrack": "_documents",
    "AgentTracks": "_documents",
    "CastDocument": "_truth_documents",
    "CastMember": "_truth_documents",
    "ConsentAnswer": "_documents",
    "ConsentRequest": "_documents",
    "Decision": "_documents",
    "EscortDocument": "_documents",
    "EventDocument": "_truth_documents",
    "IntelligenceDocument": "_documents",
    "MissionOrder": "_documents",
    "NoFlyDocument": "_documents",
    "OperatorLinkDocument": "_documents",
    "OrderAnswer": "_documents",
    "OrderDocument": "_documents",
    "PictureDocument": "_truth_documents",
    "SightingDocument": "_truth_documents",
    "TargetReport": "_documents",
    "TruthDocument": "_truth_documents",
    "VehicleDocument": "_truth_documents",
    "ViewDocument": "_truth_documents",
    "parse_document": "_documents",
    "escort_document": "_escort",
    "AgentExit": "_facts",
    "AgentStart": "_facts",
    "AnyFact": "_facts",
    "Arithmetic": "_facts",
    "BenchTraceback": "_facts",
    "Confinement": "_facts",
    "Fact": "_facts",
    "FirmwareBuild": "_facts",
    "FirmwareEnds": "_facts",
    "OverheadFidelity": "_facts",
    "PixelDetectorBuild": "_facts",
    "ServiceUse": "_facts",
    "ServicesLetIn": "_facts",
    "StepTiming": "_facts",
    "SuspectEnds": "_facts",
    "Texts": "_facts",
    "TruthGiven": "_facts",
    "TruthSightings": "_facts",
    "WarpLibrary": "_facts",
    "fact_of": "_facts",
    "facts_of": "_facts",
    "ChecksOptions": "_measure",
    "Measure": "_measure",
    "Option": "_measure",
    "Tape": "_measure",
    "Timed": "_measure",
    "detections_by_frame": "_measure",
    "MavlinkJson": "_mqtt_documents",
    "MqttAck": "_mqtt_documents",
    "MqttEnd": "_mqtt_documents",
    "MqttReady": "_mqtt_documents",
    "MqttTick": "_mqtt_documents",
    "FIRMWARE_FAILED": "_outcome",
    "PROBES": "_outcome",
    "Blame": "_outcome",
    "Evidence": "_outcome",
    "Observation": "_outcome",
    "Outcome": "_outcome",
    "SessionFailure": "_outcome",
    "SessionResult": "_outcome",
    "probes_of": "_outcome",
    "losses_of": "_outcome",
    "PluginGroup": "_plugins",
    "failure_text": "_plugins",
    "load_plugin": "_plugins",
    "package_of": "_plugins",
    "plugins": "_plugins",
    "OnProgress": "_progress",
    "ProgressUpdate": "_progress",
    "ignore_progress": "_progress",
    "realized_of": "_realized",
    "Record": "_record",
    "Tap": "_record",
    "NO_DISTORTION": "_rendering",
    "CameraPose": "_rendering",
    "ChecksHost": "_rendering",
    "Geometry": "_rendering",
    "Ground": "_rendering",
    "Labels": "_rendering",
    "Lens": "_rendering",
    "Light": "_rendering",
    "Look": "_rendering",
    "NamesBuild": "_rendering",
    "OpenRenderer": "_rendering",
    "Picture": "_rendering",
    "Pixels": "_rendering",
    "Renderer": "_rendering",
    "Stage": "_rendering",
    "distortion_faults": "_rendering",
    "lens_of": "_rendering",
    "CameraFrame": "_scene",
    "CameraPicture": "_scene",
    "Detection": "_scene",
    "DetectionFrame": "_scene",
    "Detector": "_scene",
    "ObservesCameras": "_scene",
    "OpenPixelDetector": "_scene",
    "OpenScene": "_scene",
    "PixelDetector": "_scene",
    "Scene": "_scene",
    "Sighting": "_scene",
    "VersionedDetector": "_scene",
    "MeasureRequest": "_surrogate",
    "Prediction": "_surrogate",
    "Surrogate": "_surrogate",
    "MAX_LINE_BYTES": "_tick",
    "Ack": "_tick",
    "End": "_tick",
    "Hello": "_tick",
    "Tick": "_tick",
    "TickMessage": "_tick",
    "line_fault": "_tick",
    "read_line": "_tick",
    "write_line": "_tick",
    "CAMERA_OPENED": "_topics",
    "DETECTOR_OPENED": "_topics",
    "FIRMWARE_BOOTED": "_topics",
    "OPERATOR_GIVES_BACK": "_topics",
    "OPERATOR_LINK": "_topics",
    "OPERATOR_TAKES": "_topics",
    "SESSION_EVENTS": "_topics",
    "TF": "_topics",
    "TF_STATIC": "_topics",
    "TRUTH_ACTORS": "_topics",
    "TRUTH_CAST": "_topics",
    "TRUTH_ODOMETRY": "_topics",
    "TRUTH_PICTURES": "_topics",
    "TRUTH_VEHICLE": "_topics",
    "TRUTH_VIEW": "_topics",
    "VehicleTopics": "_topics",
    "is_mavlink_from_agent": "_topics",
    "mavlink_topic": "_topics",
    "truth_depth_topic": "_topics",
    "truth_mask_topic": "_topics",
    "BootsFirmware": "_vehicle",
    "CarriesCamera": "_vehicle",
    "LinkSpec": "_vehicle",
    "MavlinkTap": "_vehicle",
    "OpenVehicle": "_vehicle",
    "Vector": "_vehicle",
    "Vehicle": "_vehicle",
    "VehicleCondition": "_vehicle",
    "VehiclePlan": "_vehicle",
    "VehicleState": "_vehicle",
}

__getattr__ = lazy_names(__name__, _MODULES)

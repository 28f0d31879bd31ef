"""What was true in a run: the actors and the task, where the vehicle flew, which faults it met."""

from ._fault_schedule import EXACT_S as EXACT_S
from ._fault_schedule import FaultKind as FaultKind
from ._fault_schedule import FaultSpan as FaultSpan
from ._fault_schedule import faults_met as faults_met
from ._fault_schedule import in_span as in_span
from ._fault_schedule import outcome_by_agent_fault as outcome_by_agent_fault
from ._fault_schedule import scheduled_faults as scheduled_faults
from ._flown_track import MIN_OUT_S as MIN_OUT_S
from ._flown_track import NEAR_HOME_M as NEAR_HOME_M
from ._flown_track import FlownTrack as FlownTrack
from ._flown_track import distance_beyond as distance_beyond
from ._flown_track import ordered_silent_s as ordered_silent_s
from ._truth import GroundTruth as GroundTruth
from ._truth import RoleName as RoleName
from ._truth import SubArea as SubArea
from ._truth import Target as Target
from ._truth import subjects_of_reports as subjects_of_reports

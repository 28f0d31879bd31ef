"""The measures: pure functions from a tape to one number, by name in the entry-point group `rebar.measures`.

docs/measures.md says of each what it measures, when it is considered, and what its options are.
"""

from __future__ import annotations

from ._asking import Asked as Asked
from ._asking import check_options as check_options
from ._asking import measure_all as measure_all
from ._bystanders import bystander_count_right as bystander_count_right
from ._bystanders import bystanders_declared as bystanders_declared
from ._bystanders import bystanders_known_near_targets as bystanders_known_near_targets
from ._bystanders import marks_clear_of_bystanders as marks_clear_of_bystanders
from ._bystanders import marks_on_adversaries as marks_on_adversaries
from ._bystanders import nearest_bystander_right as nearest_bystander_right
from ._bystanders import surroundings_seen as surroundings_seen
from ._bystanders import withheld_until_clear as withheld_until_clear
from ._compliance import area_kept as area_kept
from ._compliance import attitude_stable as attitude_stable
from ._compliance import ceiling_kept as ceiling_kept
from ._compliance import floor_kept as floor_kept
from ._compliance import geofence_kept as geofence_kept
from ._compliance import height_kept as height_kept
from ._compliance import no_fly_kept as no_fly_kept
from ._compliance import no_fly_margin as no_fly_margin
from ._compliance import speed_kept as speed_kept
from ._fairness import detection_fairness as detection_fairness
from ._fairness import track_fairness as track_fairness
from ._measured import Finding as Finding
from ._measured import Measured as Measured
from ._measured import not_considered as not_considered
from ._mission import battery_reserve as battery_reserve
from ._mission import landing_accuracy as landing_accuracy
from ._mission import mission_flown as mission_flown
from ._mission import mission_time as mission_time
from ._perception import detection_precision as detection_precision
from ._perception import detection_role_right as detection_role_right
from ._perception import detection_share as detection_share
from ._perception import steady_detection as steady_detection
from ._reports import no_false_reports as no_false_reports
from ._reports import priority_order as priority_order
from ._reports import report_accuracy as report_accuracy
from ._reports import targets_reported as targets_reported
from ._search import area_searched as area_searched
from ._search import late_intelligence_served as late_intelligence_served
from ._search import priority_visited as priority_visited
from ._search import sub_areas_reached as sub_areas_reached
from ._search import targets_seen as targets_seen
from ._standoff import landing_clear as landing_clear
from ._standoff import loiter_limited as loiter_limited
from ._standoff import no_low_overflight as no_low_overflight
from ._standoff import slow_near_bystanders as slow_near_bystanders
from ._standoff import standoff_kept as standoff_kept
from ._tracks import classified_share as classified_share
from ._tracks import no_false_tracks as no_false_tracks
from ._tracks import track_accuracy as track_accuracy
from ._tracks import track_confidence_honest as track_confidence_honest
from ._tracks import track_continuity as track_continuity
from ._tracks import track_freshness as track_freshness
from ._tracks import track_role_right as track_role_right
from ._tracks import track_uniqueness as track_uniqueness

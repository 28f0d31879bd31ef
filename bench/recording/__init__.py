"""Recordings: MCAP files written as a session runs, read back, and decoded to the tape that measures read.

from bench.recording import read_simspec, read_tape
tape, simspec = read_tape("run/recording.mcap"), read_simspec("run/recording.mcap")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._difference import RecordingDifference as RecordingDifference
    from ._difference import recording_difference as recording_difference
    from ._distance import TruthDistance as TruthDistance
    from ._distance import truth_distance as truth_distance
    from ._reader import check_whole as check_whole
    from ._reader import read_metadata as read_metadata
    from ._reader import read_records as read_records
    from ._reader import read_simspec as read_simspec
    from ._reader import read_tape as read_tape
    from ._recorder import Recorder as Recorder
    from ._recorder import open_recording as open_recording
    from ._tape import TapeBuilder as TapeBuilder

__getattr__ = lazy_names(__name__)

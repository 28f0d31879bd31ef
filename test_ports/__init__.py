"""Test ports: the recorder, recordings read back, and the measures that turn streams into observables.

from test_ports import measure_all, read_simspec, read_tape
tape, simspec = read_tape("run/recording.mcap"), read_simspec("run/recording.mcap")
print(measure_all({"OBS-1": ("targets_reported", {"within_m": 20.0})}, tape, simspec))
"""

from __future__ import annotations

from ._reading import Recovered as Recovered
from ._reading import read_metadata as read_metadata
from ._reading import read_records as read_records
from ._reading import read_simspec as read_simspec
from ._reading import read_tape as read_tape
from ._reading import recover as recover
from ._recorder import Recorder as Recorder
from ._recorder import open_recording as open_recording
from ._tape import TapeBuilder as TapeBuilder
from .measures import check_options as check_options
from .measures import measure_all as measure_all

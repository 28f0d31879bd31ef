"""The measures that turn the streams of one run into observables, and how to declare a measure.

    from test_ports import Finding, measure, not_considered

    @measure
    def highest_share(tape: Tape, simspec: SimSpec, *, of_m: float = 100.0) -> Finding:
        '''Greatest height of the flight over `of_m`, at most 1.'''
        return Finding(min(1.0, float(tape.vehicle_position_enu_m[:, 2].max(initial=0.0)) / of_m))

An entry point of the group `rebar.measures` makes it known: `highest_share = "your_package:highest_share"`.
"""

from ._declaration import DeclaredMeasure as DeclaredMeasure
from ._declaration import DeclaredOption as DeclaredOption
from ._declaration import Finding as Finding
from ._declaration import Limit as Limit
from ._declaration import Positive as Positive
from ._declaration import measure as measure
from ._declaration import not_considered as not_considered

"""Sessions of a campaign flown somewhere. The dispatcher hands realizations to an executor: the pool of worker processes on
this machine, or a Dask cluster. A worker flies them one after another; `_flight` flies one, in the worker's own process.
"""

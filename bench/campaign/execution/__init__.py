"""Sessions of a campaign flown. The dispatcher hands realizations to the pool of worker processes. A worker flies them one
after another; `_flight` flies one, in the worker's own process.
"""

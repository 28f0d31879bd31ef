"""Sessions run by worker processes: tasks, the local pool, the worker, and how a run is asked to stop."""

"""Parameters: the store, the MAVLink service that serves it, and the tables that fill it."""

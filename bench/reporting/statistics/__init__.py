"""The statistics that the report shows."""

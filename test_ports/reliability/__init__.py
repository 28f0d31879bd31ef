"""Measures of how vehicle and agent get through faults and outages."""

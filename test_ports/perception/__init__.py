"""Measures of what the agent perceives: its detections and its tracks against the truth."""

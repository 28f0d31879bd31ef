"""Guidance: what can be flown, and which target it gives the airframe in each step."""

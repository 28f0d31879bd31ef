"""Measures of the mission: flown, brought home, searched."""

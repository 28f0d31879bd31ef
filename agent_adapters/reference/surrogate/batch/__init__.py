"""Missions as arrays, before anything flies: scenes, limits, airspace, interruptions, random draws."""

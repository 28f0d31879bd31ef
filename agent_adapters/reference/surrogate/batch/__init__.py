"""Missions as arrays, before anything flies: scenes, limits, forbidden airspace, interruptions, random
draws.
"""

"""Missions: transfer, storage and flight of plans."""

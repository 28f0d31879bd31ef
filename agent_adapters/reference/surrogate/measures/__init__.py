"""Observables of the flown missions."""

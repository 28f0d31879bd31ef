"""Measures of safe flight, by the truth alone: distance from people and limits of flight."""

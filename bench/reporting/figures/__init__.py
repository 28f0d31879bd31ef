"""The figures: pure functions from data to SVG."""

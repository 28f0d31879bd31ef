"""What to do next, when a target is identified, and what to report."""

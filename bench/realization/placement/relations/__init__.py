"""Relations that a place can keep: to ground, other groups, headings, lines of sight and patrol routes."""

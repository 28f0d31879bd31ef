"""Relations that a place can keep: to the ground, to other groups, to headings, lines of sight and patrol
routes.
"""

"""The search for places: seeded sampling first, then a CP-SAT solver over pools of places."""

"""Proofs that a scene has no arrangement, from bounds on area, number, distance and heading."""

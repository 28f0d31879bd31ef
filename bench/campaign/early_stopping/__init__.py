"""Design points that stop before all their replicates are flown, because their pass rate is already decided."""

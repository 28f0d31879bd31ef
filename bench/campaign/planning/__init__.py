"""From a campaign document to realizations: SimSpecs, placed scenes, and an estimate before anything is flown."""

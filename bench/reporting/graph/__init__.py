"""A decomposition as a drawing."""

"""From pixels to tracks on the ground."""

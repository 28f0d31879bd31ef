"""What the surrogates fly, see and report."""

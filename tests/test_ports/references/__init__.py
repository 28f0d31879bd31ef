"""What references of measures share: they use no code of the measures."""

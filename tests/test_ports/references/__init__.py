"""What references of measures share, and the references: they use no code of the measures."""

"""What was true in a run, and where the vehicle flew: what every measure judges by."""

"""MAVLink services that arm, move and identify the vehicle."""

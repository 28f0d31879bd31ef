"""What the controller holds: its state, stored plans and parameters, and texts."""

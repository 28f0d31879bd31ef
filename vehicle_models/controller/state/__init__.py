"""What the controller holds: its state, stored plans and parameters, texts and log records."""

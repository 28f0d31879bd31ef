"""An agent that ends at once."""

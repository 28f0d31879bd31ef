"""Measures of the agent's reports: targets and the bystanders near them."""

"""The assurance case of an agent: what the runs of a campaign support, in the Goal Structuring Notation."""

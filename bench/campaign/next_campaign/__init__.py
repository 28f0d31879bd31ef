"""A proposal for the campaign to fly after a finished one."""

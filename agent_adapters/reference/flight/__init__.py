"""Flying: the autopilot's client, paths round what is forbidden, care for people, home and down."""

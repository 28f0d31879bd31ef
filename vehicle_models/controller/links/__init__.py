"""Links to clients: sockets, MAVLink frames, signing and the queue of messages to send."""

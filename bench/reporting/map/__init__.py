"""One run as a map: what is drawn, and which runs are chosen."""

"""Telemetry: what the vehicle sends unasked, as streams, texts and events."""

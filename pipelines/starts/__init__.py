"""Peaks of tension after starts with a jump and with a ramp."""

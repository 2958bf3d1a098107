"""Modes of the rigid chain on an extensible cable."""

"""Error against run time of all models."""

"""Studies of a guy in the wind."""

"""Run times of single parts of the package."""

"""Coverage of the intervals of peaks."""

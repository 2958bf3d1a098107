"""Outcomes of all schemes of the chain on stiff and extreme scenes."""

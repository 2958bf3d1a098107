"""Converged runs of the continuous cable, and its checks against theory."""

"""Errors of the condensed model on scenes that the modes were not trained on."""

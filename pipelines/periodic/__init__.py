"""Periodic responses of the condensed model beside those of the full chain."""

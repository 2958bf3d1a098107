"""A viscous damper on a stay: constants, sag, amplitude."""

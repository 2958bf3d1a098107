"""Alias of :mod:`cablepod.examples` for one release."""

from cablepod.examples import *  # noqa: F403 - the names of its __all__

"""Stringing tables by the exact catenary beside those by parabolas."""

"""Initial shape of Example 2 that explains Table 2."""

"""Solutions by other formulas and solvers, for tests to compare with."""

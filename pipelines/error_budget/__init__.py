"""Terms of the error of the condensed model."""

"""The elastic chain beside other packages."""

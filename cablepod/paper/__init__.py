"""Reproduce the tables and figures of the paper.

Modules: `table1` (Table 1, Example 1), `examples` (Table 2, Examples 2 to 4), `initial_shape` (initial shapes that explain
Table 2), `routes` (three routes to the modes), `validity` (range of validity of the chain's basis), `figures`, and `report`.
"""

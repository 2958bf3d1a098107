"""The paper reproduced: its tables and figures beside our own; each module is one piece of it.

`statics` (Table 1, Example 1), `examples` (Table 2, Examples 2 to 4), `starts` (which start explains Table 2), `routes`
(the three routes to the modes), `validity` (how far the chain's basis holds), `figures`, and the report of them all.
"""

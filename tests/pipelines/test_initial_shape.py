"""The search of initial shapes that explain Table 2 of the paper, in small."""

from __future__ import annotations

import pytest
from initial_shape.run import search


@pytest.mark.slow
def test_a_search_polishes_what_it_draws():
    found = search(draws=12, polished=1, most_evaluations=25, seed=3)
    assert float(found.polished_misfit[0]) < float(found.search_misfit.min())
    again = search(draws=12, polished=1, most_evaluations=25, seed=3)
    assert again.identical(found)

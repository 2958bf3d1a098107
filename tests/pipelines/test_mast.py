"""Studies of a mast: MoorDyn's lines beside its guys."""

from __future__ import annotations

import pytest
from mast import moordyn_lines, opensees


@pytest.mark.slow
def test_chains_as_guys_agree_with_moordyn(tmp_path):
    pytest.importorskip("moordyn")
    rows = moordyn_lines.compare(opensees.still_mast(tmp_path), 20)
    errors = {row[2]: [float(text.split()[0]) for text in row[4:]] for row in rows}
    assert max(errors["chain, 20 links"]) < 2.0  # percent
    assert errors["condensed, r = 4"][0] < 1.5  # guys of the top level

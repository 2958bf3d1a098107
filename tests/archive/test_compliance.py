"""The checker of CF and ACDD finds only what is allowed."""

import pytest
from compliance import check_compliance
from results import KINDS

from cablepod.archive import write


@pytest.mark.slow
def test_the_real_checker_finds_only_what_is_allowed(tmp_path):
    check_compliance({kind: write(make(), tmp_path / f"{kind}.nc") for kind, make in KINDS.items()}, tmp_path)

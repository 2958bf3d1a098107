"""The command imports dask.array only where it makes such arrays, and xarray knows them then."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys
from cablepod.cli import main
assert main(["check", "example2"]) == 0
print("dask.array" in sys.modules)
import xarray as xr
from xarray.namedarray.pycompat import array_type, mod_version
data = xr.Dataset({"a": ("x", [1.0, 2.0, 3.0])}).chunk(x=2)
print(data.chunks["x"], isinstance(data["a"].data, array_type("dask")), mod_version("dask").major >= 2024, float(data["a"].sum()))
"""


def test_dask_is_imported_at_its_first_use_and_known_to_xarray_then():
    run = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert run.stdout.splitlines()[-2:] == ["False", "(2, 1) True True 6.0"]

"""Functions that keep results between calls: the page that lists them, and how they are cleared."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import numpy as np

import cablepod as cp
from cablepod import examples
from cablepod._caches import loaded_caches

ROW = re.compile(r"^\| `([\w.]+)` \| [^|]+ \| [^|]+ \| ([^|]+) \|$", re.MULTILINE)
PAGE = Path(cp.__file__).parent / "CACHES.md"


def test_the_page_lists_every_cache_with_its_bound():
    for module in pkgutil.walk_packages(cp.__path__, "cablepod."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    found = {
        name.removeprefix("cablepod."): cache.cache_parameters()["maxsize"] for name, cache in loaded_caches().items()
    }
    without_arguments = {name for name, cache in loaded_caches().items() if not cache.__wrapped__.__code__.co_argcount}
    listed = dict(ROW.findall(PAGE.read_text(encoding="utf-8")))
    assert set(listed) ^ set(found) == set()
    wrong = [
        f"{name}: {bound}, in the code {found[name]}"
        for name, bound in listed.items()
        if bound != str(found[name])
        and not (bound == "one" and f"cablepod.{name}" in without_arguments)
        and not (bound.startswith("one for each") and found[name] is None)
    ]
    assert wrong == []


def test_no_module_keeps_results_in_a_dictionary_of_its_own():
    pattern = re.compile(r"^_?[A-Za-z_]+(?:: [^=\n]+)? = (?:\{\}|dict\(\)|Weak\w+\(\)|OrderedDict\(\))$", re.MULTILINE)
    assert pattern.findall("_BASES: dict[int, int] = {}\n_KEPT = WeakKeyDictionary()")
    package = PAGE.parent
    found = {str(path.relative_to(package)): pattern.findall(path.read_text()) for path in package.rglob("*.py")}
    found = {name: lines for name, lines in found.items() if lines}
    assert list(found) == ["archive/_attributes.py"]  # _STAMPS, a record of times, see the page


def test_clearing_forgets_what_is_kept_and_changes_no_result():
    scene = examples.scene("example2")
    before = cp.catenary.rest(scene)
    assert cp.clear_caches() > 0
    assert all(cache.cache_info().currsize == 0 for cache in loaded_caches().values())
    again = cp.catenary.rest(scene)
    for name, variable in before.data_vars.items():
        np.testing.assert_array_equal(again[name].values, variable.values)
    assert before.attrs == again.attrs

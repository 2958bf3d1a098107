"""Compilation of kernels by numba, with a cache on disk that sees edits in every kernel file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.compiler import CompilerBase, DefaultPassBuilder

#: Sets of fast-math flags; none assumes finite numbers, so that tests for them keep their meaning.
#: Products and sums in one instruction, where the machine has it.
FUSED = {"contract"}
#: Sums may be reordered, which vectorises them.
REORDERED = {"reassoc", "nsz"}
REORDERED_FUSED = {"reassoc", "nsz", "contract"}
#: The same, and divisions become products with the inverse.
FAST_DIVISION = {"contract", "reassoc", "arcp", "nsz"}
#: Locators of numba's cache in the order tried: a folder given by the user, beside the source, the user's cache folder.
_LOCATORS = "cablepod._jit.GivenFolder, cablepod._jit.BesideSource, cablepod._jit.UserFolder"


@cache
def source_stamp() -> str:
    """Hash the sources of all kernels: a kernel is compiled anew when one that it calls in another file changes."""
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted([*root.glob("*/_kernels*.py"), Path(__file__)]):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


class _PackageStamp:
    """Source stamp of a cached function: that of all kernels instead of its own file."""

    def get_source_stamp(self) -> str:
        """Return the stamp that an entry of the cache must have."""
        return source_stamp()


class GivenFolder(_PackageStamp, caching.UserProvidedCacheLocator):
    """Cache in the folder that ``NUMBA_CACHE_DIR`` names."""


class BesideSource(_PackageStamp, caching.InTreeCacheLocator):
    """Cache in ``__pycache__`` beside the source."""


class UserFolder(_PackageStamp, caching.UserWideCacheLocator):
    """Cache in the user's cache folder, where the source cannot be written beside."""


class _CacheFile(caching.IndexDataCacheFile):
    """Files of a kernel's cache; damaged ones count as missing, so that the kernel is compiled and they are written again."""

    def load(self, key: Any) -> Any:
        """Return what was kept for a signature, None without it."""
        try:
            return super().load(key)
        except Exception:  # of pickle: any
            return None

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception:  # of pickle: any
            return {}


class _Noalias(CompilerBase):
    """Compiler of kernels whose array arguments share no memory."""

    def define_pipelines(self) -> list[Any]:
        """Set the flag that numba sets for its own parallel loops, and compile as usual."""
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


def compiled(
    function: Callable[..., Any] | None = None, *, noalias: bool = False, counted: bool = True, **options: Any
) -> Any:
    """Compile a kernel with the options that all share: cached, without the GIL, IEEE division; use as a decorator.

    Parameters
    ----------
    function
        The kernel, where the decorator is used without options.
    noalias
        Whether no two array arguments share memory: loops that write to one and read from many others are vectorised then.
    counted
        Whether references to arrays are counted, which a kernel that makes arrays needs.  Of a short kernel with many views the
        counts are half of the time.
    **options
        Further options of :func:`numba.njit`, such as ``inline`` and ``fastmath``.
    """
    if function is None:
        return lambda kernel: compiled(kernel, noalias=noalias, counted=counted, **options)
    if noalias:
        options["pipeline_class"] = _Noalias
    if not counted:
        options["_nrt"] = False
    config: Any = numba.config
    given, config.CACHE_LOCATOR_CLASSES = config.CACHE_LOCATOR_CLASSES, _LOCATORS
    try:  # numba reads it where a function with a cache is made, here and nowhere later
        kernel = numba.njit(cache=True, error_model="numpy", nogil=True, **options)(function)
        if isinstance(
            files := getattr(getattr(kernel, "_cache", None), "_cache_file", None), caching.IndexDataCacheFile
        ):
            files.__class__ = _CacheFile
        return kernel
    finally:
        config.CACHE_LOCATOR_CLASSES = given

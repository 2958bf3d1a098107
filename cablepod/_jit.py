"""Compilation of kernels by numba, with a cache on disk that sees edits of a kernel and of all that it may call."""

from __future__ import annotations

import gc
import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching, types
from numba.core.compiler import Compiler, DefaultPassBuilder, Flags
from numba.core.registry import CPUDispatcher

#: Options of numba, which has no types of them.
_CONFIG: Any = numba.config
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

#: How files of kernels import one another; tests/package/test_jit.py holds that there is no other way.
_IMPORTED_KERNELS = re.compile(r"^from cablepod\.(\w+)(?:\.| import )((?:_kernels|_formulas)\w*)", re.MULTILINE)


@cache
def source_stamp(path: Path) -> str:
    """Hash the source of a file of kernels with those that it imports: kernels compile anew when one that they call changes."""
    digest = hashlib.sha256()
    for file in [*sorted(_with_imported(path)), Path(__file__)]:
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


@cache
def _with_imported(path: Path) -> frozenset[Path]:
    """Return a file of kernels and all files of kernels that it imports, directly or not."""
    root = Path(__file__).parent
    names = _IMPORTED_KERNELS.findall(path.read_text(encoding="utf-8"))
    files = (root / folder / f"{name}.py" for folder, name in names)
    return frozenset({path}).union(*(_with_imported(file) for file in files if file.exists()))


class _PackageStamp:
    """Source stamp of a cached function: that of all files whose kernels it may call instead of its own alone."""

    _py_file: str

    def get_source_stamp(self) -> str:
        """Return the stamp that an entry of the cache must have."""
        return source_stamp(Path(self._py_file))


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


class _Flags(Flags):
    """Flags of a compilation, equal where the same ones are set to the same values.

    Flags are part of the keys by which numba finds the types of functions.  Its own comparison asks for the values of all flags
    of both, set or not, and its hash is the same for all: that took a sixth of a first call.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __eq__(self, other: object) -> bool:
        return self._values == other._values if isinstance(other, Flags) else NotImplemented


class _Compiler(Compiler):
    """Compiler of kernels."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a kernel, without searches for garbage in the many objects of compilers, which take a seventh of the time."""
        self.state.flags = _Flags(self.state.flags)
        collecting = gc.isenabled()  # not where the kernel is compiled for another one
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if collecting:
                gc.enable()


class _Noalias(_Compiler):
    """Compiler of kernels whose array arguments share no memory."""

    def define_pipelines(self) -> list[Any]:
        """Set the flag that numba sets for its own parallel loops, and compile as usual."""
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


class _KernelCache(caching.FunctionCache):
    """Cache of a kernel, whose damaged files count as missing."""

    def __init__(self, function: Callable[..., Any]) -> None:
        given, _CONFIG.CACHE_LOCATOR_CLASSES = _CONFIG.CACHE_LOCATOR_CLASSES, _LOCATORS
        try:  # numba reads it where a cache is made, here and nowhere later
            super().__init__(function)
        finally:
            _CONFIG.CACHE_LOCATOR_CLASSES = given
        stamp, name = self._impl.locator.get_source_stamp(), self._impl.filename_base
        self._cache_file = _CacheFile(cache_path=self._cache_path, filename_base=name, source_stamp=stamp)


class _Kernel(CPUDispatcher):
    """Compiled function of the package."""

    def enable_caching(self) -> None:
        """Keep what is compiled on disk."""
        self._cache = _KernelCache(self.py_func)


class _ForAllIntegers(_Kernel):
    """Kernel that is compiled for the types of the integers that other kernels give it, not for their values."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the signature of a call by another kernel."""
        return super().get_call_template(
            [_without_value(kind) for kind in args], {name: _without_value(kind) for name, kind in kws.items()}
        )


def _without_value(kind: Any) -> Any:
    """Return the type of a literal integer, and every other type as it is."""
    return types.unliteral(kind) if isinstance(kind, types.IntegerLiteral) else kind


def compiled(
    function: Callable[..., Any] | None = None,
    *,
    noalias: bool = False,
    counted: bool = True,
    literal: bool = True,
    **options: Any,
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
    literal
        Whether a literal integer that another kernel gives is a type of its own, for which the kernel is compiled anew, as numba
        does.  False saves that for kernels that are called with many rows of a table.
    **options
        Further options of :func:`numba.njit`, such as ``inline`` and ``fastmath``.
    """
    if function is None:
        return lambda kernel: compiled(kernel, noalias=noalias, counted=counted, literal=literal, **options)
    if _CONFIG.DISABLE_JIT:  # numba is switched off
        return function
    # what is not said a kernel would take over from the first one that calls it, and with it speed and rounding
    options = {"fastmath": False, "forceinline": False, "_nrt": counted} | options
    options["no_cfunc_wrapper"] = True  # it takes a tenth of the compilation, and nobody calls a kernel from C
    if function.__name__.startswith("_"):  # called by kernels only; a wrapper for Python takes 10 ms for each array
        options.setdefault("no_cpython_wrapper", True)
    shared = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True}
    kernel = (_Kernel if literal else _ForAllIntegers)(
        function, targetoptions=shared | options, pipeline_class=_Noalias if noalias else _Compiler
    )
    kernel.enable_caching()
    return kernel

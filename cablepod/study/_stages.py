"""Stages of a study: their results, written and reported as soon as they are there, and the files of a folder."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from cablepod import archive
from cablepod._models import REDUCED
from cablepod.archive._folder import check_folder, new_results, sole_run
from cablepod.errors import RunStopped, warn
from cablepod.integrate._request import check_progress
from cablepod.parameters._checks import truth
from cablepod.study._figures import FIGURES, MAST_FIGURES, check_backend

#: Stages of a cable beside the reduced models, and of a mast.
STAGES = (
    "scene", "summary", "catenary", "chain_rest", "chain", "chain_half", "tension", "modes", "normal_modes", "comparison",
    "chains",
)  # fmt: skip
MAST_STAGES = ("scene", "rest", "frequencies", "motion", "guys")
#: Runs of which a part is written where they stop.
MAY_STOP = ("chain", "motion")
#: What differs between warnings of one kind: the name of the model, and numbers.
OF_MODEL, NUMBER = re.compile(r"of the model \w+"), re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class OnceEach:
    """Warnings of several runs, of which those are left out that differ from an earlier one in model and numbers alone."""

    def __init__(self) -> None:
        self.seen: set[tuple[type[Warning], str]] = set()
        self.left_out = 0

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Collect the warnings in the block, and give those of a new kind at its end, also where it raises."""
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                yield
        finally:
            for warning in caught:
                kind = warning.category, NUMBER.sub("#", OF_MODEL.sub("", str(warning.message)))
                if kind in self.seen:
                    self.left_out += 1
                else:
                    self.seen.add(kind)
                    warn(warning.message)


@dataclass(frozen=True)
class Stages:
    """Results of the stages by name; each is written and reported as soon as it is added."""

    folder: Path | None
    progress: Callable[[str, float], None] | None
    report: Callable[[str, xr.Dataset], None] | None
    results: dict[str, xr.Dataset] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    compile_times: list[float] = field(default_factory=list)
    notes: OnceEach = field(default_factory=OnceEach)

    def add(self, name: str, result: xr.Dataset) -> xr.Dataset:
        """Store, write and report the result of a stage."""
        if self.folder is not None:
            archive.write(result, self.folder / f"{name}.nc", overwrite=True)
        self.results[name] = result
        if self.report is not None:
            self.report(name, result)
        return result

    def simulate(
        self, name: str, label: str, measure: Any, call: Callable[..., xr.Dataset]
    ) -> tuple[xr.Dataset, dict[str, float]]:
        """Add the result of a call with its run times, or the partial result of a stopped run.

        Parameters
        ----------
        name, label
            Of the stage, and of its progress.
        measure
            :func:`cablepod.study._timing.timed` or :func:`cablepod.study._models.timed_twice`.
        call
            Call of a model, which takes the keyword `progress`.
        """
        progress = say = None
        if self.progress is not None:
            progress = partial(self.progress, label)
            say = partial(self.progress, f"{label}: compiling", 0.0)
            progress(0.0)
        try:
            with self.notes.collected():
                result, row = measure(call, progress=progress, say=say)
        except RunStopped as error:
            if error.partial is not None:
                self.add(f"{name}_incomplete", error.partial)
            raise
        result.attrs["wall_time_s"] = row["call_time"]
        self.compile_times.append(row["compile_time"])
        return self.add(name, result), row

    def tree(self) -> xr.DataTree:
        """Return a tree with a node for each stage."""
        root = xr.Dataset(
            attrs={
                "title": self.results["scene"].attrs["title"],
                "left_out": self.left_out,
                "compile_time_s": sum(self.compile_times),
                "notes_left_out": self.notes.left_out,
            }
        )
        return xr.DataTree.from_dict({"/": root, **self.results}, name="study")


@contextmanager
def stages_in(
    out: str | os.PathLike[str] | None,
    models: Iterable[str] = (),
    *,
    overwrite: bool,
    progress: Callable[[str, float], None] | None,
    report: Callable[[str, xr.Dataset], None] | None,
) -> Iterator[Stages]:
    """Provide the stages of a study, whose files replace all those of an old one of any scene when the block ends.

    Parameters
    ----------
    out, overwrite, progress, report
        As of :func:`cablepod.study.run`.
    models
        Names of the reduced models.

    Raises
    ------
    ArchiveError
        If the folder cannot be made or written, another run is at work there, or it holds files of a study and `overwrite` is
        false.
    """
    check_progress(progress)
    overwrite = truth("overwrite", overwrite)
    if out is None:
        yield Stages(None, progress, report)
        return
    check_backend()
    path = Path(out)
    stages = [*STAGES, *MAST_STAGES, *(f"{name}_incomplete" for name in MAY_STOP)]
    of_models = [file.name for name in (*REDUCED, *models) for file in path.glob(f"{name}_r*.nc")]
    figures = [f"{name}.png" for name in dict.fromkeys((*FIGURES, *MAST_FIGURES))]
    files = [*(f"{name}.nc" for name in dict.fromkeys(stages)), *figures, *of_models]
    check_folder(path, files, overwrite=overwrite)
    with sole_run(path), new_results(path, files) as folder:
        try:
            yield Stages(folder, progress, report)
        except RunStopped:  # what it computed is kept, beside an old study
            for name in MAY_STOP:
                for file in folder.glob(f"{name}_incomplete.nc"):
                    file.replace(path / file.name)
            raise

"""Simulate the members of a scene, and say what came out."""

from __future__ import annotations

from functools import partial
from inspect import signature
from pathlib import Path

import xarray as xr

from cablepod import archive
from cablepod._models import Model, model_of
from cablepod.archive._folder import check_folder
from cablepod.archive._manifest import MODES, describe_ensemble, peak_of, read_manifest
from cablepod.cli import _arguments, _group, _map, _page, _summary
from cablepod.cli._group import say
from cablepod.cli._progress import Bars, member_bar, telling_of_compilation
from cablepod.errors import SceneError
from cablepod.examples import scene_path
from cablepod.scene._read import read_scene
from cablepod.study._modes import make_modes


def simulate(
    scene: str,
    out: str,
    model: str | None,
    modes: str | None,
    options: tuple[str, ...],
    scheduler: str | None,
    workers: int | None,
    batch: int,
    hertz: bool,
    page: str | None,
    overwrite: bool,
    verify: bool,
) -> None:
    """Simulate all members of a scene, with the options of the command."""
    from cablepod import ensemble  # slow to import
    from cablepod.ensemble._models import check_option_names, check_scene_of_model

    _group.import_matplotlib()
    folder = _arguments.folder(out)
    dataset = read_scene(scene_path(scene))
    if "ensemble_json" not in dataset.attrs:
        raise SceneError(f"ensemble: missing in {scene}; allowed: a table with members and ensemble.ranges")
    model = model or ("mast" if "mast_height" in dataset else "chain")
    chosen = model_of(model)
    check_scene_of_model(dataset, chosen)
    given, of_run = _arguments.model_options(options), signature(ensemble.run).parameters
    check_option_names(chosen, given, [name for name in chosen.options() if name not in of_run])
    check_folder(folder, (), overwrite=overwrite, key="--out")  # before modes are made
    target = _page.checked(page)
    scenes = ensemble.design(dataset)
    say("\n".join(filter(None, (scenes.attrs["title"], _summary.remarks(dataset)))))
    modes_dataset = (
        archive.read(modes, verify=verify) if modes else _modes_of_ensemble(dataset, folder, chosen, overwrite)
    )
    with telling_of_compilation(), member_bar(model, scenes.sizes["member"]) as progress, _page.heard() as notes:
        results = ensemble.run(
            scenes,
            folder,
            model=model,
            modes=modes_dataset,
            scheduler=scheduler,
            workers=workers,
            batch=batch,
            overwrite=overwrite,
            progress=progress,
            **given,
        )
    peaks = "\n".join([_map.write(folder, results, hertz=hertz), *peak_of(read_manifest(folder))])
    say(peaks)
    summary = describe_ensemble(folder, brief=True)
    found = {"scene": scenes, "ensemble": results}
    text = "\n".join((peaks, summary))
    say("\n".join(filter(None, (summary, _page.write(target, found, text=text, notes=notes)))))


def _modes_of_ensemble(scene: xr.Dataset, folder: Path, model: Model, overwrite: bool) -> xr.Dataset | None:
    """Return the modes of a reduced model: those of the ensemble that goes on, or new ones; None for a full model."""
    if model.layout is None:
        return None
    if (folder / MODES).exists() and not overwrite:
        return archive.read(folder / MODES)
    with telling_of_compilation(), Bars() as bars:
        modes = make_modes(scene, layout=model.layout, progress=partial(bars, "chain, for the modes"))
    say(f"modes: {modes.sizes['mode']} of layout {model.layout}, from a run of the scene itself")
    return modes

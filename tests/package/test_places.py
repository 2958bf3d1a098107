"""Particles and links have places and no labels, by which xarray would pair those of the same number of different meshes."""

from __future__ import annotations

import numpy as np
import pytest
from public_calls import datasets
from scenes import SOFT

import cablepod as cp
from cablepod.ensemble import design

TENSIONS = ("position", "tension", "tension_extremes")
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


def chains() -> list:
    """The soft chain with two numbers of links."""
    scene = cp.make_scene(SOFT)
    return [cp.chain.simulate(scene, links=links, step=1e-3, outputs=TENSIONS) for links in (10, 20)]


@pytest.mark.parametrize("spatial", [False, True])
def test_no_result_has_labels_of_particles_or_links(spatial):
    for name, result in datasets(spatial).items():
        assert not {"particle", "link"} & set(result.variables), name


@pytest.mark.parametrize("read", [False, True])
def test_results_of_different_meshes_have_no_difference(read, tmp_path):
    pair = chains()
    if read:
        pair = [cp.archive.read(cp.archive.write(run, tmp_path / f"{i}.nc")) for i, run in enumerate(pair)]
    for name in ("position", "tension", "tension_maximum"):
        dim = "particle" if name == "position" else "link"
        with pytest.raises(ValueError, match="conflicting dimension sizes"):
            pair[0][name] - pair[1][name]
        # with labels they would be paired by their numbers, which this is about
        labelled = [run[name].assign_coords({dim: np.arange(run.sizes[dim])}) for run in pair]
        assert (labelled[0] - labelled[1]).sizes[dim] == pair[0].sizes[dim]


def test_tensions_of_all_models_have_places_that_are_no_labels():
    scene = cp.make_scene(SOFT)
    chain = chains()[0]
    modes, normal = cp.pod.decompose(chain, rank=2), cp.pod.decompose(chain, rank=2, layout="normal")
    runs = [
        chain,
        cp.chain.rest(scene, links=10),
        cp.cable.simulate(scene, elements=2, step=1e-3, outputs=TENSIONS),
        cp.galerkin.simulate(scene, modes, step=1e-3, outputs=TENSIONS),
        cp.condensed.simulate(scene, normal, outputs=TENSIONS),
        cp.condensed.simulate(scene, normal, outputs=("tension_mean",)),
    ]
    for run in runs:
        places = 0.5 * (run.arc_length.values[1:] + run.arc_length.values[:-1])
        np.testing.assert_array_equal(run.link_arc_length, places)
        assert "link" not in run.indexes
        for name in {"tension", "tension_mean"} & set(run):
            assert run[name].coords["link_arc_length"].attrs["units"] == "m"
    assert "link_arc_length" not in cp.chain.simulate(scene, links=10, step=1e-3, outputs=("position",)).coords


@pytest.mark.parametrize("step", [None, 1e-3])  # ways of a batch
def test_tensions_of_some_links_say_which(step):
    scene = cp.make_scene(SOFT)
    normal = cp.pod.decompose(chains()[0], rank=4, layout="normal")  # as in other tests of lanes
    options = {"links": [9, 2], "step": step, "outputs": ("tension",)}
    alone = cp.condensed.simulate(scene, normal, **options)
    assert alone.link_number.values.tolist() == [9, 2]
    np.testing.assert_allclose(alone.link_arc_length / alone.unstretched_length, [0.85, 0.15], rtol=1e-14)
    members = design(scene, {"cable.top_tension": [150.0, 200.0]}, members=3, seed=1)
    many = cp.condensed.simulate(members, normal, **options)
    assert many.link_number.values.tolist() == [9, 2]
    assert many.link_arc_length.dims == ("member", "link")
    for member in range(3):
        one = cp.condensed.simulate(members.isel(member=member), normal, **options)
        np.testing.assert_allclose(many.link_arc_length[member], one.link_arc_length, rtol=1e-14)


def test_a_picked_link_keeps_its_place():
    run = chains()[0]
    top = run.isel(link=-1)
    assert float(top.link_arc_length) == run.link_arc_length.values[-1]
    cp.compare.errors(top, run)  # its place is no coordinate of links that could be out of order
    cp.pod.decompose(run.isel(link=[3]), rank=1)

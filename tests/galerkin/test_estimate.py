"""What the Galerkin model says of its own error, and when it warns."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import spatial
from suite import slow

import cablepod as cp

TIMES = np.arange(0.0, 4.01, 0.1)


def scene_of(soft, *, tension=300.0, omega=1.0, amplitude=0.05):
    soft["cable"] = {**soft["cable"], "youngs_modulus": 2e8, "top_tension": tension}
    soft["motion"]["upper"]["x"] |= {"amplitude": amplitude, "angular_frequency": omega}
    return soft


def windy(soft):
    """Make it spatial, with a load across that varies."""
    mapping = spatial(soft)
    mapping["ends"]["upper"][2] = 3.0
    mapping["load"] = {"uniform": [0.0, 0.0, 2.0], "kind": "harmonic", "amplitude": 0.5, "angular_frequency": 2.0}
    return mapping


def slack(soft, ratio):
    """Hang a cable of `ratio` times the chord between the ends."""
    soft = scene_of(soft)
    del soft["cable"]["top_tension"]
    soft["cable"]["unstretched_length"] = 10.0 * ratio
    return cp.make_scene(soft)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # of the worst pairs, which are meant to be bad
@pytest.mark.parametrize("layout", ["separate", slow("vector")])
@pytest.mark.parametrize("dims", [2, slow(3)])
@pytest.mark.parametrize("law", ["linear", "green"])
def test_the_error_estimate_tells_the_error_against_the_chain(soft, dims, layout, law):
    options = {"times": TIMES, "tolerance": 1e-4, "law": law}
    estimates, errors, modes = [], [], None
    for tension, omega in ((150.0, 1.0), (300.0, 2.0), (600.0, 3.0)):
        mapping = scene_of(soft, tension=tension, omega=omega)
        if dims == 3:
            mapping = windy(mapping)
        scene = cp.make_scene(mapping)
        chain = cp.chain.simulate(scene, scheme="velocity_verlet", outputs=("position",), **options)
        modes = cp.pod.decompose(chain, layout=layout) if modes is None else modes
        for rank in (1, 2, 4):
            run = cp.galerkin.simulate(scene, modes, rank=rank, **options)
            estimates.append(run.attrs["error_estimate"])
            errors.append(float(cp.compare.errors(run, chain).error_max))
    assert min(errors) < 5e-2 < 0.5 < max(errors)
    # linearised about the motion: of errors as large as the motion only that they are, and no more than 2
    near = np.where(np.array(errors) < 0.5, 2.0, 4.0)
    assert (np.abs(np.log(np.divide(estimates, np.minimum(errors, 2.0)))) < np.log(near)).all()


def test_of_all_modes_nothing_is_left_but_waves_along_the_cable(soft):
    scene = cp.make_scene(scene_of(soft, omega=0.3, amplitude=0.01))
    chain = cp.chain.simulate(scene, times=TIMES, outputs=("position",))
    run = cp.galerkin.simulate(scene, cp.pod.decompose(chain), times=TIMES, law="linear")
    assert run.attrs["error_estimate"] < 1e-3


@pytest.mark.parametrize(("ratio", "known"), [(1.05, True), (1.5, False)])
def test_a_cable_of_much_sag_has_an_estimate_until_it_runs_back_along_its_chord(soft, ratio, known):
    scene = slack(soft, ratio)
    chain = cp.chain.simulate(scene, times=TIMES, tolerance=1e-5, outputs=("position",))
    run = cp.galerkin.simulate(scene, cp.pod.decompose(chain), rank=3, times=TIMES, law="linear", tolerance=1e-5)
    error, told = float(cp.compare.errors(run, chain).error_max), run.attrs["error_estimate"]
    assert np.isnan(told) != known
    assert not known or 0.5 < told / error < 2.0


def test_no_motion_has_no_error_and_what_is_not_asked_for_is_left_out(soft):
    scene = cp.make_scene(scene_of(soft))
    modes = cp.pod.decompose(cp.chain.simulate(scene, times=TIMES, tolerance=1e-4, outputs=("position",)))
    assert cp.galerkin.simulate(scene, modes, times=[0.0], step=1e-3).attrs["error_estimate"] == 0.0
    run = cp.galerkin.simulate(scene, modes, times=TIMES, step=1e-3, outputs=())
    assert "error_estimate" not in run.attrs
    assert "position" not in run
    whole = cp.galerkin.simulate(scene, modes, times=TIMES, step=1e-3, outputs=("position",))
    assert run.attrs["smallest_stretch"] == whole.attrs["smallest_stretch"] > 1.0


def test_members_have_an_estimate_each(soft):
    scene = cp.make_scene(scene_of(soft))
    modes = cp.pod.decompose(cp.chain.simulate(scene, times=TIMES, tolerance=1e-4, outputs=("position",)))
    many = scene.assign(cable_top_tension=("member", [250.0, 400.0], scene["cable_top_tension"].attrs))
    found = cp.galerkin.simulate(many, modes, rank=2, times=TIMES, step=1e-3)
    for i in range(2):
        alone = cp.galerkin.simulate(many.isel(member=i), modes, rank=2, times=TIMES, step=1e-3)
        assert float(found["error_estimate"][i]) == alone.attrs["error_estimate"] > 0.0


@pytest.fixture
def modes(soft):
    scene = cp.make_scene(scene_of(dict(soft), tension=150.0))
    return cp.pod.decompose(cp.chain.simulate(scene, times=TIMES, tolerance=1e-4, outputs=("position",)))


def test_it_warns_where_links_are_compressed(soft, modes):
    scene = cp.make_scene(scene_of(soft, tension=150.0, amplitude=-0.4, omega=2.0))
    with pytest.warns(cp.OutOfRangeWarning, match=r"links are compressed, to 0\.\d+ of their unstretched length"):
        cp.galerkin.simulate(scene, modes, rank=2, times=TIMES, step=1e-3, outputs=())


def test_it_warns_of_fast_ends_in_scenes_unlike_those_of_the_snapshots(soft, modes):
    fast = cp.make_scene(scene_of(soft, omega=40.0, amplitude=1e-4))
    options = {"rank": 2, "times": TIMES, "step": 1e-3, "outputs": ()}
    with pytest.warns(
        cp.OutOfRangeWarning, match=r"times the first axial frequency, .* modes of slower motion lack waves"
    ):
        cp.galerkin.simulate(fast, modes, **options)
    own = cp.pod.decompose(cp.chain.simulate(fast, times=TIMES, tolerance=1e-4, outputs=("position",)))
    assert (
        cp.galerkin.simulate(fast, own, **options).attrs["forcing_over_axial_frequency"] > 0.2
    )  # and no warning, an error here


def test_it_warns_where_it_expects_to_be_wrong(soft, modes):
    scene = cp.make_scene(scene_of(soft, tension=600.0, omega=3.0))
    with pytest.warns(cp.OutOfRangeWarning, match=r"expects an error of .* of the model Galerkin, r = 1, above 0.5\)"):
        cp.galerkin.simulate(scene, modes, rank=1, times=TIMES, step=1e-3)


@pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")  # links are compressed too
def test_it_warns_where_a_given_step_makes_energy(soft, modes):
    scene = cp.make_scene(scene_of(soft, omega=10.0))
    with pytest.warns(
        cp.NotConvergedWarning,
        match=r"energy balance violated by .* % of the exchanged energy \(energy_defect, trapezoidal",
    ):
        cp.galerkin.simulate(scene, modes, times=TIMES, scheme="trapezoidal", step=0.1, law="green", outputs=())


@pytest.mark.slow
def test_the_estimate_contains_the_law_of_the_snapshots(soft):
    scene = cp.make_scene(scene_of(soft, tension=600.0) | {"damping": {"mass_proportional": 0.5}})
    chains = {law: cp.chain.simulate(scene, times=TIMES, outputs=("position",), law=law) for law in ("linear", "green")}
    told = {}
    for law, chain in chains.items():
        modes = cp.pod.decompose(chain, rank=6)
        assert modes.attrs["law"] == law
        run = cp.galerkin.simulate(scene, modes, times=TIMES)
        told[law] = run.attrs["error_estimate"]
        if law == "linear":
            assert told[law] == pytest.approx(float(cp.compare.errors(run, chain).error_max), rel=0.2)
            del modes.attrs["law"]
            assert cp.galerkin.simulate(scene, modes, times=TIMES).attrs["error_estimate"] == told[law]
    assert told["green"] < 0.2 * told["linear"]
    assert "law" not in cp.pod.decompose(list(chains.values()), rank=2).attrs

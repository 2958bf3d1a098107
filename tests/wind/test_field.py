"""Wind at points: mean profiles, spectra, coherence, reproducibility."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import small
from scipy.fft import next_fast_len
from suite import slow
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp


def scene(wind=None, **tables):
    return cp.make_scene({**GUY, "wind": wind or KAIMAL, **tables})


def test_mean_profiles():
    points = [[0.0, 10.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.02, 0.0]]
    logarithmic = cp.wind.field(scene(WIND), points=points).mean_wind.sel(component="x").values
    assert logarithmic == pytest.approx([25.0, 25.0 * np.log(40.0 / 0.03) / np.log(10.0 / 0.03), 0.0])
    power = cp.wind.field(scene({**WIND, "profile": "power", "exponent": 0.16}), points=points).mean_wind[:, 0].values
    assert power == pytest.approx([25.0, 25.0 * 4.0**0.16, 25.0 * 0.002**0.16])
    oblique = cp.wind.field(scene({**WIND, "direction": [3.0, 0.0, -4.0], "profile": "uniform"}), points=points)
    assert oblique.mean_wind.values == pytest.approx(np.tile([15.0, 0.0, -20.0], (3, 1)))
    assert np.ptp(oblique.wind.values, axis=0).max() == 0.0
    raised = cp.wind.field(scene({**WIND, "ground": -30.0}), points=points).mean_wind[0, 0]
    assert float(raised) == pytest.approx(25.0 * np.log(40.0 / 0.03) / np.log(10.0 / 0.03))


def kaimal(n, height, across):
    """Spectra of Simiu and Scanlan, written out again [m2/s]."""
    speed = 25.0 * np.log(height / 0.03) / np.log(10.0 / 0.03)
    friction = 0.4 * 25.0 / np.log(10.0 / 0.03)
    f = n * height / speed
    shape = 15.0 * f / (1.0 + 9.5 * f) ** (5 / 3) if across else 200.0 * f / (1.0 + 50.0 * f) ** (5 / 3)
    return friction**2 * shape / n


def test_variances_and_covariances_of_kaimal_turbulence():
    heights = np.array([10.0, 20.0, 40.0, 55.0])
    points = np.column_stack([np.zeros(4), heights, np.zeros(4)])
    windy = scene(time={"duration": 300.0, "interval": 1.0})
    fields = [cp.wind.field(windy, seed=seed, points=points) for seed in range(200)]
    parts = np.stack([(field.wind - field.mean_wind).values for field in fields])  # seed, time, point, component
    assert np.abs(parts[..., 1]).max() == 0.0  # no vertical gusts
    samples = parts.shape[1]
    count = next_fast_len(int(np.ceil(300.0 / 0.1 * (1 - 1e-12))) + 2)
    n = np.arange(1, (count - 1) // 2 + 1) / (0.1 * count)
    assert samples == 3001
    speed = 25.0 * np.log(heights / 0.03) / np.log(10.0 / 0.03)
    for component, across in ((0, False), (2, True)):
        spectra = np.array([kaimal(n, height, across) for height in heights])
        expected = np.sqrt((spectra / (0.1 * count)).sum(axis=1))
        covariance = np.einsum("stp,stq->pq", parts[..., component], parts[..., component]) / (200 * samples)
        deviation = np.sqrt(np.diag(covariance))
        assert deviation == pytest.approx(expected, rel=0.015)
        for p in range(4):
            for q in range(p):
                decay = 10.0 * abs(heights[p] - heights[q]) / (0.5 * (speed[p] + speed[q]))
                coupled = (np.sqrt(spectra[p] * spectra[q]) * np.exp(-n * decay) / (0.1 * count)).sum()
                assert covariance[p, q] / expected[p] / expected[q] == pytest.approx(
                    coupled / expected[p] / expected[q], abs=0.015
                )
    across_along = np.einsum("stp,stp->p", parts[..., 0], parts[..., 2]) / (200 * samples)
    assert np.abs(across_along).max() < 0.015 * deviation.max() * expected.max()


#: Spectra n S / u*^2, or of von Karman over the variance, along and across, by f = n h / U, n L / U, or 1200 m n / U10.
SPECTRA = {
    "kaimal": lambda f: (200.0 * f / (1.0 + 50.0 * f) ** (5 / 3), 15.0 * f / (1.0 + 9.5 * f) ** (5 / 3)),
    "davenport": lambda x: (4.0 * x**2 / (1.0 + x**2) ** (4 / 3), 0.75**2 * 4.0 * x**2 / (1.0 + x**2) ** (4 / 3)),
    "von_karman": lambda g: (
        4.0 * g / (1.0 + 70.8 * g**2) ** (5 / 6),
        2.0 * g * (1.0 + 188.8 * g**2) / (1.0 + 70.8 * g**2) ** (11 / 6),  # with L / 2, as isotropic turbulence has it
    ),
}


@pytest.mark.parametrize("name", ["kaimal", slow("davenport"), slow("von_karman")])
def test_spectra_and_coherences_in_an_oblique_wind(name):
    """Periodograms and cross spectra of points above, beside and behind each other, over 24 seeds, in bands."""
    points = np.array([[0.0, 10.0, 0.0], [0.0, 30.0, 0.0], [-6.4, 30.0, 4.8], [6.0, 30.0, 8.0]])
    given = {"intensity": 0.16, "length_scale": 120.0} if name == "von_karman" else {}
    wind = {
        "speed": 25.0,
        "direction": [0.6, 0.0, 0.8],
        "turbulence": {"spectrum": name, "decay": [8.0, 14.0], **given},
    }
    windy = scene(wind, time={"duration": 600.0, "interval": 1.0})
    axes = np.array([[0.6, 0.0, 0.8], [-0.8, 0.0, 0.6]])
    fields = [cp.wind.field(windy, seed=seed, points=points) for seed in range(24)]
    gusts = np.stack([((field.wind - field.mean_wind).values @ axes.T)[:-1] for field in fields])
    waves, n = np.fft.rfft(gusts, axis=1) * 0.1, np.fft.rfftfreq(6000, 0.1)[:, None]
    speed = 25.0 * np.log(points[:, 1] / 0.03) / np.log(10.0 / 0.03)
    scales = {"kaimal": points[:, 1] / speed, "davenport": np.full(4, 1200.0 / 25.0), "von_karman": 120.0 / speed}
    size = 0.16 * 25.0 if given else 0.4 * 25.0 / np.log(10.0 / 0.03)
    for low, high in ((0.05, 0.2), (0.2, 1.0)):
        band = (n[:, 0] >= low) & (n[:, 0] < high)
        rtol = 4.0 / np.sqrt(24 * band.sum())  # four standard deviations
        for component in (0, 1):
            own = waves[:, band][..., component]
            expected = size**2 * SPECTRA[name](n[band] * scales[name])[component] / n[band]
            periodogram = 2.0 * (np.abs(own) ** 2).mean(axis=0) / 600.0
            np.testing.assert_allclose(periodogram.mean(axis=0), expected.mean(axis=0), rtol=rtol)
            for p, q, decay, behind in ((0, 1, 8.0 * 20.0, 0.0), (1, 2, 14.0 * 8.0, 0.0), (1, 3, 0.0, 10.0)):
                turned = np.exp(2j * np.pi * n[band, 0] * behind / 25.0)  # Taylor, by the speed at the reference height
                cross = 2.0 * (np.conj(own[..., p]) * own[..., q]).mean(axis=0) / 600.0 * turned
                root = np.sqrt(expected[:, p] * expected[:, q])
                coherent = root * np.exp(-n[band, 0] * decay / (0.5 * (speed[p] + speed[q])))
                assert abs(cross.mean() - coherent.mean()) < rtol * root.mean()


@pytest.mark.parametrize("roughness", [1.0, 5.0])
def test_a_guy_from_the_ground_of_a_city(roughness):
    """The mean wind vanishes below the roughness length, the gusts there are those of its least height, of variance 6 u*^2."""
    fields = [cp.wind.field(scene({**KAIMAL, "roughness_length": roughness}), seed=seed) for seed in range(40)]
    gusts = np.stack([(field.wind - field.mean_wind).values[..., 0] for field in fields])
    friction = 0.4 * 25.0 / np.log(10.0 / roughness)
    # the harmonics from 1/60 Hz on hold the rest of the integral of 200 / (1 + 50 f)^(5/3); the deviation of 40 seeds is 3 %
    height = np.maximum(fields[0].position[:, 1].values, 1.5 * roughness)
    speed = 25.0 * np.log(height / roughness) / np.log(10.0 / roughness)
    low, high = (1.0 + 50.0 * n * height / speed for n in (0.5 / 60.0, 5.0))
    expected = np.sqrt(6.0 * (low ** (-2 / 3) - high ** (-2 / 3))) * friction
    np.testing.assert_allclose(gusts.std(axis=(0, 1)), expected, rtol=0.12)


def test_von_karman_has_the_given_intensity():
    turbulence = {"spectrum": "von_karman", "intensity": 0.2, "length_scale": 100.0}
    windy = scene({**WIND, "turbulence": turbulence}, time={"duration": 1800.0, "interval": 1.0})
    field = cp.wind.field(windy, points=[[0.0, 10.0, 0.0]])
    # the harmonics from 1/1800 to 5 Hz hold 98 % of the variance
    assert float(field.wind[:, 0, 0].std()) == pytest.approx(0.2 * 25.0, rel=0.02)
    assert float(field.wind[:, 0, 2].std()) == pytest.approx(0.2 * 25.0, rel=0.02)


def test_davenport_has_six_times_the_squared_friction_velocity():
    windy = scene({**WIND, "turbulence": {"spectrum": "davenport"}}, time={"duration": 3600.0, "interval": 1.0})
    field = cp.wind.field(windy, points=[[0.0, 30.0, 0.0]])
    friction = 0.4 * 25.0 / np.log(10.0 / 0.03)
    # the integral of 4 x / (1 + x^2)^(4/3) up to x is 6 (1 - (1 + x^2)^(-1/3)); 5 Hz are x = 240
    assert float(field.wind[:, 0, 0].std()) == pytest.approx(
        np.sqrt(6.0 * (1.0 - (1.0 + 240.0**2) ** (-1 / 3))) * friction, rel=0.01
    )


def test_turbulence_travels_with_the_wind():
    windy = scene({**KAIMAL, "profile": "uniform"}, time={"duration": 300.0, "interval": 0.1})
    field = cp.wind.field(windy, points=[[0.0, 20.0, 0.0], [25.0, 20.0, 0.0]])
    first, second = field.wind[:, 0, 0].values, field.wind[:, 1, 0].values
    lags = range(30)
    products = [np.corrcoef(first[: first.size - lag], second[lag:])[0, 1] for lag in lags]
    assert int(np.argmax(products)) == 10  # 25 m at 25 m/s
    assert max(products) > 0.999


def test_fields_depend_on_the_seed_alone():
    windy = scene()
    one, same, other = cp.wind.field(windy), cp.wind.field(scene()), cp.wind.field(windy, seed=8)
    assert np.array_equal(one.wind, same.wind)
    assert np.abs((one.wind - other.wind).values).max() > 1.0
    assert np.array_equal(
        other.wind, cp.wind.field(scene({**KAIMAL, "turbulence": {"spectrum": "kaimal", "seed": 8}})).wind
    )
    # the model's links and the instants asked for do not matter
    assert np.array_equal(one.wind, cp.wind.field(scene(chain={"links": 40})).wind)
    assert np.array_equal(one.wind[100], cp.wind.field(windy, times=[10.0]).wind[0])
    half = cp.wind.field(windy, times=[10.05]).wind[0].values
    assert half == pytest.approx(0.5 * (one.wind[100] + one.wind[101]).values)


def test_fields_do_not_depend_on_threads():
    from threadpoolctl import threadpool_limits

    windy = scene()
    with threadpool_limits(1):
        one = cp.wind.field(windy)
    with threadpool_limits(2):
        two = cp.wind.field(windy)
    assert np.array_equal(one.wind, two.wind)


def test_first_values_of_a_seed_are_those_of_any_machine():
    # the bits of the generator are fixed; sums of the FFT differ by rounding
    field = cp.wind.field(scene(), points=[[0.0, 30.0, 0.0]], times=[0.0, 0.1, 0.2])
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([7, 0])))
    count = next_fast_len(int(np.ceil(60.0 / 0.1 * (1 - 1e-12))) + 2)
    n = np.arange(1, (count - 1) // 2 + 1) / (0.1 * count)
    phase, size = 2 * np.pi * generator.random(n.size), np.sqrt(2.0 * kaimal(n, 30.0, False) / (0.1 * count))
    expected = [(size * np.cos(2 * np.pi * n * t + phase)).sum() for t in (0.0, 0.1, 0.2)]
    assert (field.wind[:, 0, 0] - field.mean_wind[0, 0]).values == pytest.approx(expected, rel=1e-9)


def test_points_are_read_by_their_labels():
    rest = cp.catenary.rest(scene(), points=5).position
    fields = [
        cp.wind.field(scene(), points=p) for p in (rest.values, rest.isel(coordinate=[2, 0, 1]), rest.transpose())
    ]
    for other in fields[1:]:
        np.testing.assert_array_equal(other.position, rest)
        np.testing.assert_array_equal(other.wind, fields[0].wind)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"times": [1.0, 0.5]}, "times"),
        ({"times": [-1.0]}, "times"),
        ({"seed": -1}, "seed"),
        ({"points": [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]}, "points"),
        ({"points": [[0.0, 1.0], [0.0, 2.0]]}, "points"),
        ({"points": "many"}, "points"),
    ],
)
def test_wrong_options_are_refused(options, key):
    with pytest.raises(cp.SceneError, match=rf"^{key}.*: given .*; allowed: "):
        cp.wind.field(scene(), **options)


def test_a_scene_without_wind_is_refused():
    with pytest.raises(cp.SceneError, match=r"^wind: missing; allowed: "):
        cp.wind.field(cp.make_scene(GUY))


def test_members_vary_the_wind():
    members = cp.ensemble.design(
        scene(), {"wind.speed": [10.0, 20.0, 30.0], "wind.turbulence.seed": [1, 5, 9]}, members=3, sampling="list"
    )
    fields = cp.wind.field(members)
    assert fields.wind.dims == ("member", "time", "point", "component")
    alone = cp.wind.field(members.isel(member=1, drop=True))
    assert np.array_equal(fields.wind.isel(member=1), alone.wind)


def exact(mapping):
    """A scene with turbulence whose mean is exact."""
    return {**mapping, "wind": {**KAIMAL, "turbulence": {**KAIMAL["turbulence"], "exact_mean": True}}}


def test_an_exact_mean_is_that_of_the_run_and_nothing_else_changes():
    plain, field = (cp.wind.field(cp.make_scene(tables)) for tables in ({**GUY, "wind": KAIMAL}, exact(GUY)))
    np.testing.assert_allclose(field.wind.mean("time"), field.mean_wind, rtol=0.0, atol=1e-12 * 25.0)
    off = plain.wind.mean("time") - plain.mean_wind
    assert float(abs(off).max()) > 0.02
    np.testing.assert_allclose(
        plain.wind - field.wind, off.broadcast_like(plain.wind).transpose(*plain.wind.dims), atol=1e-10
    )


def test_an_exact_mean_holds_for_masts_and_in_files(tmp_path):
    scene = small(lambda mapping: mapping.update(wind={**exact(GUY)["wind"], "direction": [0.6, 0.0, 0.8]}))
    field = cp.wind.field(scene)
    np.testing.assert_allclose(field.wind.mean("time"), field.mean_wind, rtol=0.0, atol=1e-12 * 25.0)
    cp.archive.write(scene, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    assert bool(again.wind_turbulence_exact_mean) is True
    np.testing.assert_array_equal(cp.mast.simulate(again).guy_tension, cp.mast.simulate(scene).guy_tension)


def fine(mapping):
    """A scene whose gusts have samples every 0.04 s."""
    return {**mapping, "wind": {**KAIMAL, "turbulence": {**KAIMAL["turbulence"], "interval": 0.04}}}


def test_finer_samples_have_the_shorter_gusts_too():
    """The variance is that of the harmonics up to 12.5 Hz, in place of 5 Hz, at points of their own."""
    tables = {**fine(GUY), "time": {"duration": 600.0, "interval": 1.0}}
    field = cp.wind.field(cp.make_scene(tables), points=[[0.0, 10.0, 0.0]])
    np.testing.assert_allclose(field.time, 0.04 * np.arange(15001), rtol=1e-12)
    spectrum = np.abs(np.fft.rfft((field.wind - field.mean_wind).values[:-1, 0, 0])) ** 2 * 2.0 * 0.04 / 15000
    n = np.arange(spectrum.size) / 600.0
    for low, high in ((1.0, 5.0), (5.0, 12.0)):
        band = (n > low) & (n < high)
        # the field is part of a longer period, which leaks, by 600 harmonics and more
        assert spectrum[band].sum() == pytest.approx(kaimal(n[band], 10.0, False).sum(), rel=0.1)


@pytest.mark.parametrize("model", ["chain", "condensed", "mast"])
def test_models_take_finer_samples_as_they_do_a_finer_field(model):
    tables = fine({**GUY, "time": {"duration": 2.0, "interval": 0.1}})
    tables["wind"]["speed"] = 15.0
    scene = small(lambda mast: mast.update(wind=tables["wind"])) if model == "mast" else cp.make_scene(tables)
    options = {"step": 0.02, "outputs": (name := "guy_tension" if model == "mast" else "position",)}
    if model == "chain":
        options = {"step": 2e-4}
    if model == "condensed":
        options["modes"] = cp.condensed.vibration_modes(scene, rank=4)
    simulate = getattr(cp, model).simulate
    coarse = scene.drop_vars("wind_turbulence_interval")
    own, given, other = (
        simulate(scene, **options),
        simulate(coarse, wind=cp.wind.field(scene), **options),
        simulate(coarse, **options),
    )
    np.testing.assert_allclose(own[name], given[name], rtol=1e-13)  # one over the interval is rounded
    assert float(abs(own[name] - other[name]).max()) > 0.0


@pytest.mark.parametrize("value", [1, 0.0, "true", None, [True]])
def test_an_exact_mean_is_true_or_false(value):
    tables = exact(GUY)
    tables["wind"]["turbulence"]["exact_mean"] = value
    with pytest.raises(cp.SceneError, match=r"^wind\.turbulence\.exact_mean: given .*; allowed: true or false"):
        cp.make_scene(tables)


@pytest.mark.slow
def test_the_mean_of_ten_minutes_is_as_far_off_as_the_page_says():
    # standard deviations over seeds of the mean over the mean wind: a scene of 600 s, 600 s of a scene of 660 s, any ten minutes
    positions = np.array([[0.0, 10.0, 0.0], [0.0, 120.0, 0.0]])
    means, scenes = {"whole": [], "part": [], "hour": []}, {}
    for duration in (600.0, 660.0, 3600.0):
        scenes[duration] = scene(time={"duration": duration, "interval": 1.0})

    def along(duration, seed):
        return cp.wind.field(scenes[duration], seed=seed, points=positions).wind[..., 0].values

    for seed in range(200):
        means["whole"].append(along(600.0, seed).mean(axis=0))
        means["part"].append(along(660.0, seed)[600:6601].mean(axis=0))
        if seed < 40:
            means["hour"] += list(along(3600.0, seed)[:36000].reshape(6, 6000, 2).mean(axis=1))
    speed = cp.wind.field(scenes[600.0], points=positions).mean_wind[:, 0].values
    spread = {name: np.std(values, axis=0) / speed for name, values in means.items()}
    # over 200 seeds a standard deviation is known to 5 %
    np.testing.assert_allclose(spread["whole"], [0.0009, 0.0008], rtol=0.2)
    np.testing.assert_allclose(spread["part"], [0.0052, 0.0072], rtol=0.2)
    np.testing.assert_allclose(spread["hour"], [0.016, 0.029], rtol=0.2)

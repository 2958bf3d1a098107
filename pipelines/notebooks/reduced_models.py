# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Reduced models
#
# A chain of 40 links takes hundreds of thousands of explicit steps, because waves run fast along it. A reduced model keeps the
# few modes that move. Two of them are here: the paper's Galerkin model and the condensed model. What do they cost at which
# error, do they predict scenes that they have not seen, and when do they fail?

# %%
import os
import time
import warnings

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod import examples as shipped

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# The motion to be predicted is Example 3 of the paper; the truth is the continuous cable, converged to $10^{-7}$ of the motion,
# which is shipped with the package.

# %%
scene = shipped.scene("example3")
truth = cp.archive.read(shipped.truth_path("example3", "linear"))
chain = cp.chain.simulate(scene, tolerance=1e-6, outputs=("position",))
cp.plots.snapshots(chain, truth, times=[0.0, 14.0, 44.0, 90.0]);

# %% [markdown]
# Displacements are magnified (the legend says how much); the chain's dots lie on the cable's lines.
#
# ## The Galerkin model
#
# Put the position together from modes, equation (36),
#
# $$ \mathbf r(\sigma, t) = (1 - \sigma)\,\mathbf r_0(t) + \sigma\,\mathbf r_n(t) + \bar{\mathbf u}(\sigma)
#    + \sum_{i=1}^{r} a_i(t)\,\boldsymbol\varphi_i(\sigma), \tag{36} $$
#
# into the equations of motion of a cable whose tension follows the law of equation (21), with the stretch $\xi$ and the
# stiffness $K$,
#
# $$ \frac{T}{\xi} = \frac{K}{2}\,(\xi^2 - 1), \tag{21} $$
#
# and ask that what is left over be normal to each mode. Law (21) makes this a polynomial in the amplitudes; its coefficients are
# computed once.

# %%
modes = cp.pod.decompose(chain, rank=8)
ranks = (1, 2, 4) if SMALL else (1, 2, 4, 8)
galerkin = {r: cp.galerkin.simulate(scene, modes, rank=r, tolerance=1e-5) for r in ranks}
cp.plots.error_over_time({f"r = {r}": cp.compare.errors(run, chain) for r, run in galerkin.items()});

# %% [markdown]
# From two modes to four the error hardly falls, though the modes themselves hold the motion eight times better (*Modes*). The
# loss is in the dynamics: modes that are left out would react on those that are kept. With eight it is small. Each run says what
# error it expects (`error_estimate`), from the residual of a richer model and without knowing any truth.

# %%
for r, run in galerkin.items():
    error = float(cp.compare.errors(run, chain).error_max)
    print(f"r = {r}: error {error:.2%}, expected by the model {run.attrs['error_estimate']:.2%}")

# %% [markdown]
# ## The condensed model
#
# Waves along a taut cable even out its tension within hundredths of a second. Take that as done at once: then the deflection $w$
# normal to the chord $\mathbf c(t)$ is all that moves,
#
# $$ \mu\,\ddot w = \left(\frac{N w'}{\zeta'}\right)' + \mathbf p \cdot \mathbf n
#    - \mu\Bigl(\ddot{\mathbf r}_0 + \frac{S}{L_0}\,\ddot{\mathbf c}\Bigr) \cdot \mathbf n, \qquad N = H(t) + \tau(S), $$
#
# and one number, $H(t)$, makes the stretch $\zeta'$ along the chord add up to its length. There is no frequency of axial waves
# left in it, so steps are hundreds of times as long.

# %%
normal = cp.pod.decompose(chain, rank=8, layout="normal")
condensed = cp.condensed.simulate(scene, normal, rank=2)
said = condensed.attrs
print(f"step limit: chain {chain.attrs['step_limit']:.1e} s, condensed {said['step_limit']:.1e} s")
print(
    f"it expects an error of {said['error_estimate']:.2%}; it is {float(cp.compare.errors(condensed, chain).error_max):.2%}"
)

# %%
cp.plots.shapes(chain, condensed, times=[0.0, 15.0, 45.0, 90.0], deflection=True);

# %% [markdown]
# ## Error against run time
#
# Measured here and now, so expect other numbers on your machine; the whole call counts, positions included. Careful
# measurements, of kernels too, are made by `pipelines/error_vs_runtime/run.py`.

# %%
def seconds(job, repeats=1 if SMALL else 5):
    """Shortest time of a few calls, after one that compiles."""
    job()
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        job()
        taken.append(time.perf_counter() - begin)
    return min(taken)

# %%
def chain_of(links, step):
    given = scene.assign(chain_links=links)
    return lambda: cp.chain.simulate(given, scheme="trapezoidal", step=step, times=truth.time.values)


def condensed_of(rank, order, step):
    options = {"rank": rank, "order": order, "scheme": "velocity_verlet", "step": step, "outputs": ("position",)}
    return lambda: cp.condensed.simulate(scene, fine, times=truth.time.values, **options)

# %%
eighty = cp.chain.simulate(scene.assign(chain_links=80), tolerance=1e-6, outputs=("position",))
fine = cp.pod.decompose(eighty, rank=8, layout="normal")
chains = [(20, 0.05), (40, 0.02), (80, 0.01), (160, 0.005)]
models = [(2, "leading", 0.05), (4, "leading", 0.05), (6, "leading", 0.05), (6, "exact", 0.02), (8, "inertial", 0.01)]
jobs = [chain_of(*setting) for setting in chains[: 2 if SMALL else None]]
jobs += [condensed_of(*setting) for setting in models[: 2 if SMALL else None]]
is_chain = np.arange(len(jobs)) < len(jobs) - (2 if SMALL else len(models))
errors = [float(cp.compare.errors(job(), truth).error_max) for job in jobs]
times = [seconds(job) for job in jobs]

# %%
measured = xr.Dataset({"error_max": ("setting", errors), "call_time": ("setting", times, {"units": "s"})})
measured["model"] = ("setting", np.where(is_chain, "chain", "condensed"))
measured["family"] = ("setting", np.where(is_chain, "full", "reduced"))
measured["scheme"] = ("setting", np.where(is_chain, "trapezoidal", "velocity_verlet"))
measured["measured_again"] = measured["on_front"] = xr.ones_like(measured.error_max)
cp.plots.error_against_run_time(measured, time="call_time");

# %%
for error, seconds_of in zip(measured.error_max[~is_chain].values, measured.call_time[~is_chain].values, strict=True):
    as_good = measured.isel(setting=is_chain & (measured.error_max.values <= 1.1 * error))
    if as_good.setting.size:  # the chains need not reach it
        print(f"error {error:.2%}: {float(as_good.call_time.min()) / seconds_of:.1f} times faster than a chain as good")

# %% [markdown]
# A chain as good is the fastest of these four whose error is at most a tenth larger. At errors of a per cent the condensed model
# is far ahead; towards small errors, with more modes and smaller steps, the gap narrows. A search among many more chains, the
# benchmark `default_calls.py`, finds default calls of the condensed model two to five times faster than the best chain, and
# those of the Galerkin model about as fast. Most of such a short call is Python, which many scenes share in a batch:
# *Parametric study*.
#
# ## A scene that the modes have not seen
#
# Train on Example 2, which is taut and slow; predict Example 3, slacker and faster.

# %%
taut = cp.chain.simulate(shipped.scene("example2"), tolerance=1e-6, outputs=("position",))
foreign = cp.pod.decompose(taut, rank=8, layout="normal")
for rank in (1, 8) if SMALL else (1, 2, 4, 8):
    run = cp.condensed.simulate(scene, foreign, rank=rank, order="exact", tolerance=1e-4)
    error = float(cp.compare.errors(run, chain).error_max)
    print(f"r = {rank}: error {error:.2%}, expected by the model {run.attrs['error_estimate']:.2%}")
print(f"outside of the training by {run.attrs['outside_training']:.2f}, in {run.attrs['outside_training_feature']}")

# %% [markdown]
# Eight modes of one scene hold the other; four are no better than two. The distance from the training scenes says *that* this is
# another scene; the estimate says what it does to the error, and it is the one to decide by.
#
# ## No snapshots, and many runs of one guy
#
# `vibration_modes` needs no chain: it solves for the small vibrations about rest. Two static shapes before them, the deflection
# at rest and its change with the distance of the ends, hold the sag.

# %%
still = cp.condensed.vibration_modes(scene, rank=6, static_modes=True)
for name, modes in {"modes of snapshots": normal, "modes without": still}.items():
    run = cp.condensed.simulate(scene, modes, rank=6)
    error = float(cp.compare.errors(run, chain).error_max)
    print(f"{name}: error {error:.2%}, expected by the model {run.attrs['error_estimate']:.2%}")

# %% [markdown]
# Members of a scene run side by side: the loop of an optimiser. Here the largest tension of the top link over the amplitude of
# the mast's motion.

# %%
amplitudes = np.linspace(-0.08, 0.08, 5 if SMALL else 41)  # m
members = scene.assign(motion_upper_x_amplitude=("member", amplitudes))


def peaks():
    """Return the largest tension of each member."""
    run = cp.condensed.simulate(members, still, step=0.02, outputs=("tension",), links=[40])
    return run.tension.values.max(axis=(1, 2))


print(f"{1e3 * seconds(peaks) / amplitudes.size:.1f} ms a run of {scene.time_duration:.0f} s")
print(f"peak tension {peaks().min():.0f} to {peaks().max():.0f} N")

# %% [markdown]
# ## A model of your own
#
# A model is a function from a scene and modes to a trajectory. Studies and ensembles take it beside those of the package, if it
# stands at the top of a module or notebook and takes `times` and `progress`; a study also gives `rank`. This one has no need of
# the modes it is given: its shapes are Legendre polynomials that vanish at both ends.


# %%
def legendre(scene, modes=None, *, rank=4, times=None, progress=None):
    """Run the condensed model on polynomials."""
    place = np.linspace(-1.0, 1.0, 41)
    shapes = [np.polynomial.Legendre.basis(k)(place) * (1.0 - place**2) for k in range(rank)]
    return cp.condensed.simulate(scene, cp.modes(np.array(shapes), scene=scene), times=times, progress=progress)


compared = cp.study.run(scene, ranks=(2, 4) if SMALL else (2, 4, 8), models=("condensed", legendre))["comparison"]
print((100.0 * compared["error_max"]).round(3).to_pandas().rename_axis("error [%]"))

# %% [markdown]
# Errors are those against the chain. Beside run times, a point for each model and number of modes:

# %%
rows = [
    (f"{model}, r = {rank}", float(point["call_time"]), float(point["error_max"]))
    for model in compared["model"].values
    for rank in compared["rank"].values
    for point in [compared.sel(model=model, rank=rank)]
]
cp.plots.error_against_run_time(rows);

# %% [markdown]
# The same function for the members of an ensemble, in threads:

# %%
tensions = cp.ensemble.design(scene, {"cable.top_tension": [12e3, 20e3]}, members=4, seed=1)
runs = cp.ensemble.run(tensions, "out/legendre", model=legendre, rank=4, overwrite=True)
print(runs["error_estimate"].to_series().map("{:.2%}".format))

# %% [markdown]
# ## When they fail
#
# Shake the mast faster and further, until the cable goes slack: then nothing is taut, waves along the chord matter, and a model
# that takes them as done is out of its range. It says so.

# %%
wild = scene.assign(motion_upper_x_angular_frequency=2.5, motion_upper_x_amplitude=-0.25, time_duration=20.0)
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    run = cp.condensed.simulate(wild, normal, rank=4, step=0.002)
for message in sorted({str(item.message) for item in told}):
    print(message, "\n")

# %%
error = float(cp.compare.errors(run, cp.chain.simulate(wild, step=1e-4)).error_max)
print(f"smallest force along the chord {run.attrs['smallest_chordwise_force']:.0f} N")
print(f"error against the chain {error:.0%}, expected by the model {run.attrs['error_estimate']:.0%}")

# %% [markdown]
# **In short.** Where the cable stays taut and its ends move slowly beside the waves along it, the condensed model gives a per
# cent with two modes and a tenth of a per cent with eight, in a fraction of the time. Where it goes slack, it says so; take the
# chain.

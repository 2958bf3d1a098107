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
# # Parametric study
#
# How far, and how fast, may a mast sway away from its guy, before the guy is pulled too hard? A map of the peak tension over
# frequency and amplitude takes hundreds of runs: of the reduced model, with spot checks by the full one.

# %%
import os
import warnings

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod import examples as shipped

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# ## Modes, once
#
# The reduced model needs modes. They come from two runs of the full chain at the slow and the fast side of the map.

# %%
base = shipped.scene("example3").assign(time_duration=10.0 if SMALL else 40.0)
sides = [base.assign(motion_upper_x_angular_frequency=omega, motion_upper_x_amplitude=0.03) for omega in (0.3, 3.0)]
modes = cp.pod.decompose([cp.chain.simulate(scene) for scene in sides], rank=6, layout="normal")
cp.plots.singular_values(modes);

# %% [markdown]
# ## Scenes
#
# The upper end moves by $f_1(t) = a\,(1 - \cos\omega t)$ along $x$, between rest and $2a$ further out. Every combination of
# $\omega$ and $a$ becomes a member of an ensemble. Frequencies are close, because resonances are narrow.

# %%
counts = (4, 4) if SMALL else (51, 12)
ranges = {
    "motion.upper.x.angular_frequency": [0.25, 4.0, counts[0]],
    "motion.upper.x.amplitude": [0.005, 0.04, counts[1]],
}
scenes = cp.ensemble.design(base, ranges)
scenes

# %% [markdown]
# ## Runs
#
# Only the extremes of the tension are kept, over all steps of a run, and the error that the model expects of itself. The folder
# holds what is done: interrupt the cell, call it again, and it goes on where it stopped. What the model warns of is printed: at
# some members it does not trust its own motion, which the second map shows.

# %%
options = {"rank": 4, "order": "exact", "tolerance": 1e-3, "outputs": ("tension_extremes", "error_estimate")}
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    results = cp.ensemble.run(scenes, "study", model="condensed", modes=modes, overwrite=True, **options)
for message in sorted({str(item.message) for item in told}):
    print(message, "\n")
results

# %% [markdown]
# ## The map

# %%
omega, sway = scenes.motion_upper_x_angular_frequency.values, 200 * scenes.motion_upper_x_amplitude.values
study = xr.Dataset({"peak": results.tension_maximum.max("link"), "error": 100 * results.error_estimate}).compute()
study["omega"] = ("member", omega, {"units": "rad/s", "long_name": "angular frequency"})
study["sway"] = ("member", sway, {"units": "cm", "long_name": "sway of the upper end"})
study["peak"].attrs = {"units": "N", "long_name": "peak tension"}
cp.plots.parameter_map(study, "peak", x="omega", y="sway");

# %% [markdown]
# On the left the sway is slow, and all that counts is its size. Ridges are resonances. Compare with the frequencies of the guy
# at rest:

# %%
vibrations = cp.cable.frequencies(base)
print("angular frequencies of the guy at rest [rad/s]:", vibrations.angular_frequency.values[:3].round(2))

# %% [markdown]
# At the right edge the sway comes near the lowest frequency. The ridge in the middle is at *half* of it: the tension of a guy
# depends on the square of its deflection, so a sway at $\omega$ also pulls at $2\omega$. No table of frequencies shows that; the
# map does.
#
# ## How far to trust it
#
# The model expects an error of its own for each run (at most 20 % is shown):

# %%
study["error shown"] = study.error.clip(max=20.0)
study["error shown"].attrs = {"units": "%", "long_name": "error expected by the model, 20 and more alike"}
cp.plots.parameter_map(study, "error shown", x="omega", y="sway", contours=False);

# %% [markdown]
# ## Spot checks
#
# The full chain, at a few members across the map and where the peak is largest:

# %%
picked = sorted(
    {*np.linspace(0, scenes.sizes["member"] - 1, 3 if SMALL else 8).astype(int).tolist(), int(np.argmax(study.peak.values))}
)
full = cp.chain.simulate(scenes.isel(member=picked), step=1e-4, outputs=("tension_extremes",))
peaks = full.tension_maximum.max("link").values
for number, peak in zip(picked, peaks, strict=True):
    one = study.isel(member=number)
    text = f"{float(one.omega):.2f} rad/s, {float(one.sway):4.1f} cm: chain {peak:6.0f} N"
    print(f"{text}, condensed {float(one.peak) / peak - 1:+.1%}, expected error of the motion {float(one.error):.3g} %")

# %%
ax = cp.plots.parameter_map(study, "peak", x="omega", y="sway")
ax.plot(omega[picked], sway[picked], "s", color="white", markeredgecolor="black", label="checked by the chain")
ax.legend(loc="upper left");

# %% [markdown]
# The peaks agree to about one per cent, even on the ridge, where the model expects of its motion that it is not to be believed:
# there two runs that start alike part, so ask for the peak and not for the position at an instant.

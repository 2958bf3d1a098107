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

# %% [markdown]
# # Parametric study
#
# How large may the sway of the mast be, at which frequency, before the guy is pulled too hard? A map of the peak tension over frequency
# and amplitude takes hundreds of runs: of the reduced model, with spot checks by the full one.

# %%
import os

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod import shipped

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# ## Modes, once
#
# The reduced model needs modes. They come from two runs of the full chain at the corners of the map: slow and fast sway.

# %%
base = shipped.scene("example3").assign(time_duration=30.0 if SMALL else 60.0)
corners = [base.assign(motion_upper_x_angular_frequency=omega, motion_upper_x_amplitude=-0.05) for omega in (0.2, 1.5)]
modes = cp.pod.decompose([cp.chain.simulate(scene) for scene in corners], rank=6, layout="normal")
cp.plots.singular_values(modes)
# %% [markdown]
# ## Scenes
#
# The end moves by $f_1(t) = a\,(1 - \cos\omega t)$. Every combination of $\omega$ and $a$ becomes a member of an ensemble.

# %%
side = 4 if SMALL else 20
ranges = {"motion.upper.x.angular_frequency": [0.2, 1.5], "motion.upper.x.amplitude": [-0.07, -0.01]}
scenes = cp.ensemble.design(base, ranges, members=side * side, sampling="grid")
scenes

# %% [markdown]
# ## Runs
#
# Only the extremes of the tension are kept, over all steps of a run. The folder holds what is done: interrupt the cell, and call it
# again, and it goes on where it stopped.

# %%
options = {"rank": 4, "order": "exact", "outputs": ("tension_extremes", "error_estimate")}
results = cp.ensemble.run(scenes, "study", model="condensed", modes=modes, overwrite=True, **options)
results

# %% [markdown]
# ## The map

# %%
study = xr.Dataset(
    {"peak": results.tension_maximum.max("link").load(), "error": 100 * results.error_estimate.load()},
    coords={
        "omega": (
            "member",
            scenes.motion_upper_x_angular_frequency.values,
            {"units": "rad/s", "long_name": "angular frequency"},
        ),
        "size": (
            "member",
            -200 * scenes.motion_upper_x_amplitude.values,
            {"units": "cm", "long_name": "sway of the upper end"},
        ),
    },
)
study["peak"].attrs = {"units": "N", "long_name": "peak tension"}
study["error"].attrs = {"units": "%", "long_name": "error expected by the model"}

# %%
cp.plots.parameter_map(study, "peak", x="omega", y="size")
# %% [markdown]
# The sway inwards slackens the guy first, and the sag that it gives in to comes back on the way out. Ridges are where the sway meets a
# frequency of the guy, or a fraction of one:

# %%
vibrations = cp.cable.frequencies(base)
print("angular frequencies of the guy at rest [rad/s]:", vibrations.angular_frequency.values[:3].round(2))

# %% [markdown]
# ## How far to trust it
#
# The model expects an error of its own for each run; this map says where the other one holds.

# %%
cp.plots.parameter_map(study, "error", x="omega", y="size")
# %% [markdown]
# ## Spot checks
#
# The full chain, at a few members across the map and where the peak is largest:

# %%
picked = sorted({*np.linspace(0, side * side - 1, 3 if SMALL else 6).astype(int).tolist(), int(study.peak.argmax())})
full = cp.chain.simulate(scenes.isel(member=picked), outputs=("tension_extremes",))
peaks = full.tension_maximum.max("link").values
for number, peak in zip(picked, peaks, strict=True):
    one = study.isel(member=number)
    text = f"{float(one.omega):.2f} rad/s, {float(one['size']):4.1f} cm: chain {peak:6.0f} N"
    print(
        f"{text}, condensed {float(one.peak):6.0f} N ({float(one.peak) / peak - 1:+.1%}), expected error {float(one.error):.2g} %"
    )

# %%
ax = cp.plots.parameter_map(study, "peak", x="omega", y="size")
ax.plot(study.omega[picked], study["size"][picked], "s", color="white", markeredgecolor="black", label="checked")
ax.legend(loc="upper left")

# %% [markdown]
# Where the check fails, the estimate should have said so: compare the two columns.

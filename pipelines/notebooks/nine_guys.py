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
# # A mast of nine guys
#
# A mast of 120 m stands on nine guys in a storm. How hard should they be pulled tight, which direction of the wind is the worst,
# and what does ice change? One hundred storms of ten minutes answer: largest tension and fatigue range of every guy.

# %%
import os
import time
import tomllib
import warnings

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod import examples

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# ## The mast at rest
#
# Three levels of three guys each. The scene is a file that comes with the package; `cp.summary` gives its static numbers.

# %%
base = examples.scene("mast120")
numbers = cp.summary(base)
print("critical factor of buckling:", round(float(numbers.buckling_factor), 2))
print("first frequencies in Hz:", numbers.frequency.values.round(3))
cp.plots.mast_shapes(cp.mast.frequencies(base, count=40));

# %% [markdown]
# Shapes in which the mast has the largest share of the energy lie from 1.2 to 1.5 Hz, among the second and third modes of the
# guys: mast and guys exchange energy. Static springs in the place of guys cannot show that.
#
# ## A minute of the storm
#
# The motion is enlarged, colours are tensions. The guys on the windward side, on the left, carry; the leeward ones sag.

# %%
minute = cp.mast.simulate(
    base, times=np.arange(0.0, 12.0 if SMALL else 60.0, 0.2),
    outputs=("displacement", "guy_position", "guy_tension", "extremes"),
)
figure, ax = plt.subplots(figsize=(6.0, 5.5), layout="constrained")
cp.plots.animate_mast(minute, frames=10 if SMALL else 150, ax=ax)

# %%
cp.plots.guy_tensions(minute);

# %% [markdown]
# ## One hundred storms
#
# Pretension of all guys, direction of the wind and thickness of the ice are varied, each combination a member. By the symmetry
# of three guys directions from 0 to 60 degrees are enough: at 0 one guy of each level faces the wind, at 60 one of each lies
# downwind. All masts of one direction share one turbulent wind.

# %%
tighter = np.array([0.8, 1.2] if SMALL else [0.7, 0.85, 1.0, 1.15, 1.3])
angles = np.array([0.0, 60.0] if SMALL else [0.0, 15.0, 30.0, 45.0, 60.0])  # degrees
ice = np.array([0.0, 0.02] if SMALL else [0.0, 0.01, 0.02, 0.03])  # m
angle, factor, thickness = (values.ravel() for values in np.meshgrid(angles, tighter, ice, indexing="ij"))

tables = tomllib.loads(examples.scene_path("mast120").read_text(encoding="utf-8"))
tables["ice"] = {"thickness": 0.0}  # kg/m3: 700 by default
ranges = {f"guy.{number}.top_tension": guy["top_tension"] * factor for number, guy in enumerate(tables["guy"], start=1)}
ranges |= {"wind.direction.x": np.cos(np.deg2rad(angle)), "wind.direction.z": np.sin(np.deg2rad(angle))}
ranges["ice.thickness"] = thickness
ranges = {path: values.tolist() for path, values in ranges.items()}
scenes = cp.ensemble.design(cp.make_scene(tables), ranges, members=factor.size, sampling="list")
scenes.sizes["member"]

# %%
begin = time.perf_counter()
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    runs = cp.mast.simulate(
        scenes, times=np.arange(0.0, 30.1 if SMALL else 600.1, 0.1), outputs=("displacement", "guy_tension", "extremes")
    )
print(f"{scenes.sizes['member']} masts in {time.perf_counter() - begin:.1f} s")
print("warnings of slack guys:", sum("slack" in str(item.message) for item in told))

# %% [markdown]
# ## Maps
#
# The peak is that of the guy with the largest one; the fatigue range is the constant range, one cycle a second, that does the
# same damage with the exponent 4.

# %%
study = xr.Dataset(
    {
        "peak": 1e-3 * runs.guy_tension_maximum.max("guy"),
        "least": 1e-3 * runs.guy_tension_minimum.min("guy"),
        "fatigue": 1e-3 * cp.fatigue.equivalent(runs.guy_tension, exponent=4.0).max("guy"),
    }
).drop_vars([name for name in runs.coords if name != "member"], errors="ignore")
study["pretension"] = ("member", factor, {"units": "1", "long_name": "pretension over that of the scene"})
study["direction"] = ("member", angle, {"units": "degrees", "long_name": "direction of the wind"})
for name, text in (("peak", "largest tension"), ("least", "least tension"), ("fatigue", "fatigue range")):
    study[name].attrs = {"units": "kN", "long_name": text}

# %%
shown = ice[[0, -1]]
figure, places = plt.subplots(2, 2, figsize=(10.0, 7.5), layout="constrained")
for row, name in zip(places, ("peak", "fatigue"), strict=True):
    for ax, coat in zip(row, shown, strict=True):
        cp.plots.parameter_map(study.isel(member=thickness == coat), name, x="pretension", y="direction", ax=ax)
        ax.set_title(f"{1e3 * coat:.0f} mm of ice")

# %% [markdown]
# More pretension raises the peak, as it adds to what the wind pulls. It lowers the fatigue range: a tight guy sags less, and its
# mast moves less. Ice weighs the guys down, and the wind finds more than twice the diameter.

# %%
best = study.isel(member=int(study.fatigue.values.argmin()))
worst = study.isel(member=int(study.fatigue.values.argmax()))
for text, one in (("least", best), ("largest", worst)):
    print(
        f"{text} fatigue range: {float(one.fatigue):.1f} kN at {float(one.pretension):g} times the pretension, wind from "
        f"{float(one.direction):g} degrees; peak {float(one.peak):.0f} kN"
    )

# %% [markdown]
# ## Which guy?

# %%
member = int(study.fatigue.values.argmax())
ranges_of_guys = 1e-3 * cp.fatigue.equivalent(runs.guy_tension.isel(member=member), exponent=4.0)
print("fatigue range of the guys in kN:", ranges_of_guys.values.round(1))
one = runs.isel(member=member)
cp.plots.spectra(one.guy_tension.isel(guy=int(ranges_of_guys.values.argmax())), one.displacement.isel(level=-1, coordinate=0));

# %% [markdown]
# ## How far to trust it
#
# - Against continuous guys, fatigue ranges and peaks of four modes err by up to 0.7 %, with ice or without, where guys stay taut
#   ([study](../mast/README.md)). A guy that goes slack is named in a warning; there they err by up to 8 %.
# - One storm for each point: another seed changes a peak by some percent, so that small steps of the maps mean nothing.
# - Static springs in the place of the guys are wrong by a third in the standard deviation of tensions.
# - The mast does not move vertically, nothing twists, the wind neither lifts nor makes guys gallop.

# %%
chain = cp.mast.simulate(
    scenes.isel(member=member, drop=True), guys="chain", links=10 if SMALL else 20, times=np.arange(0.0, 30.1, 0.1),
    outputs=("guy_tension",),
)
ours = runs.guy_tension.isel(member=member).sel(time=chain.time, method="nearest")
guy = int(ours.max("time").values.argmax())
figure, ax = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
ax.plot(chain.time, 1e-3 * chain.guy_tension[:, guy], color="0.6", linewidth=3.0, label="chain")
ax.plot(chain.time, 1e-3 * ours[:, guy], linewidth=1.0, label="condensed, four modes")
ax.set(xlabel="time [s]", ylabel=f"tension of guy {guy + 1} [kN]")
ax.legend();

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
# # Whirling: move the top of a guy by three millimetres
#
# The top of a mast sways by three millimetres, in the plane of a guy of 61 m. What does the guy do? At most frequencies nothing
# that one would see. Near its second natural frequency it swings by ten centimetres, and then it leaves the plane and goes round
# like a skipping rope. Periodic responses are solved for directly, the unstable ones too, by a model of six coordinates.

# %%
import os
import time

import numpy as np

import cablepod as cp

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %%
def guy(omega=12.58, third=(), motion=None, **tables):
    """Scene of the guy, whose top moves harmonically; `third` appends a coordinate to its ends."""
    return cp.make_scene({
        "title": "guy",
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 15000.0},
        "ends": {"lower": [0.0, 0.0, *third], "upper": [20.4, 57.7, *third]},
        "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": 0.003, "angular_frequency": omega, **(motion or {})}}},
        "damping": {"mass_proportional": 0.09},  # 1/s: 0.7 % of critical in the first mode
        "chain": {"links": 20 if SMALL else 40},
        **tables,
    })

scene = guy()
modes = cp.condensed.vibration_modes(scene, rank=3)
print("natural frequencies in rad/s:", modes.angular_frequency.values.round(2))

# %% [markdown]
# ## All responses near resonance
#
# `frequency_response` follows the responses through folds, tells which are stable, and changes to the branches that leave.

# %%
begin = time.perf_counter()
response = cp.periodic.frequency_response(scene, modes, frequency=(12.2, 12.9))
print(f"{response.sizes['point']} responses in {time.perf_counter() - begin:.2f} s")
cp.plots.frequency_response(response);

# %% [markdown]
# Stable responses are solid lines, unstable ones dashed. The large response in the plane leans to the right, as large vibrations
# stretch the guy and make it stiffer. It turns back at two folds: between them a large and a small response exist side by side.
# At the squares the guy may leave the plane. Between them the large response in the plane is unstable, and whirling is stable.

# %%
for k in range(response.sizes["bifurcation"]):
    one = response.isel(bifurcation=k)
    print(f"{float(one.bifurcation_angular_frequency):.4f} rad/s: {one.bifurcation_kind.item()}, {one.bifurcation_set.item()}")

# %% [markdown]
# ## Whirling
#
# One point of the whirling branch is the start for the orbit at 12.58 rad/s. Its Floquet multipliers lie inside of the unit
# circle: what disturbs it dies out.

# %%
harmonics = cp.periodic.frequency_response(scene, modes, frequency=(12.5, 12.7), outputs=("harmonics",))
outside = np.nan_to_num(harmonics.amplitude_out_of_plane).max(axis=1)
near = np.where(outside > 0.05, np.abs(harmonics.angular_frequency - 12.58), np.inf)
orbit = cp.periodic.orbit(scene, modes, start=harmonics.isel(point=int(np.argmin(near))))
print(f"deflection {float(orbit.deflection_maximum):.3f} m, stable: {bool(orbit.stable)}")
cp.plots.multipliers(orbit);

# %% [markdown]
# Seen along the chord, every particle goes round an ellipse, once in half a second. The lower and the upper half of the guy go
# round on opposite sides, as it is the second mode that whirls.

# %%
cp.plots.animate_orbit(orbit)

# %% [markdown]
# ## Does a full model whirl?
#
# A chain in space starts at rest, five centimetres beside the plane. Nothing else pushes it out of the plane.

# %%
third = (0.0,)
rest = cp.chain.rest(guy(third=third)).position.values
rest[:, 2] = 0.05 * np.sin(2.0 * np.pi * np.linspace(0.0, 1.0, len(rest)))
duration = 10.0 if SMALL else 600.0  # s
slowly = {"ramp": 5.0}  # s: the top begins to move without a jump
start, instants = {"points": rest.tolist()}, {"duration": duration, "interval": 0.03}
space = guy(third=third, motion=slowly, initial=start, time=instants)
begin = time.perf_counter()
run = cp.chain.simulate(space, tolerance=1e-3, outputs=("position",))
print(f"{duration:.0f} s of the chain in {time.perf_counter() - begin:.1f} s")
quarter = run.position.isel(particle=run.sizes["particle"] // 4)
quarter.sel(coordinate="z").plot(linewidth=0.4);

# %%
last = quarter.sel(coordinate="z").isel(time=slice(-400, None))
same = orbit.position.isel(particle=orbit.sizes["particle"] // 4, coordinate=2)
print(f"out of the plane at a quarter: chain {float(np.abs(last).max()):.4f} m, orbit {float(np.abs(same).max()):.4f} m")

# %% [markdown]
# At first the disturbance dies out, as the guy hardly swings in its plane. Then motion out of the plane grows for minutes, until
# the guy whirls as the model says. Time integration finds this response, because it is stable, if one waits; the unstable one in
# the plane it never finds.
#
# ## How far may the top move?
#
# The map has the growth rate of disturbances over frequency and amplitude. Above zero the guy does not stay in the plane, or
# does not follow the forcing.

# %%
count = 12 if SMALL else 100
begin = time.perf_counter()
tongues = cp.periodic.stability_map(
    scene, modes, frequency=np.linspace(12.0, 13.2, count), amplitude=np.linspace(1e-4, 0.006, count), rank=2
)
print(f"{count * count} responses in {time.perf_counter() - begin:.1f} s")
cp.plots.stability_map(tongues);

# %%
unstable = tongues.growth_out_of_plane.max("angular_frequency") > 0.0
print(f"below {1e3 * float(tongues.amplitude.where(unstable).min()):.1f} mm the guy stays in its plane at all these frequencies")

# %% [markdown]
# **In short.** `frequency_response` draws the branches, `orbit` gives one response with its multipliers, `stability_map` shows
# where it begins. Three millimetres at the top suffice for whirling, as resonance multiplies them by thirty.

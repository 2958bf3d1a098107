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
# # First look
#
# A guy of a mast: 61 m of steel rope, held at the foot and at the mast. The mast sways, and the guy with it. How does it hang,
# how does it move, what does it pull? This page goes from a scene to a picture, an animation and a file.

# %%
import os

import cablepod as cp

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))  # set where these pages are only tried out

# %% [markdown]
# ## A scene
#
# A scene is what you would tell a colleague: the cable, its ends, what moves, for how long. The same keys make a TOML file
# (`cp.read_scene`). Lengths are in m, forces in N; what is unknown or impossible is refused by its key.

# %%
scene = cp.make_scene(
    {
        "title": "a guy whose mast sways",
        "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 3750.0},
        "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.07, "angular_frequency": 0.5}}},
        "time": {"duration": 40.0, "interval": 0.1},
        "chain": {"links": 40},
    }
)
scene

# %% [markdown]
# The upper end moves along $x$ by $f_1(t) = a\,(1 - \cos \omega t)$ with $a = -0.07$ m and $\omega = 0.5$ rad/s: Example 3 of
# the paper. Seven centimetres of sixty metres; keep that in mind for the pictures.
#
# ## At rest
#
# Between its ends an elastic cable of weight $q$ per unstretched length hangs in the catenary (equations (7) to (16) of the
# paper, here with the stretch of the cable). One number fixes it: here the tension at the top, $T_1 = 3750$ N. The rest follows.

# %%
rest = cp.catenary.rest(scene)
print(
    f"unstretched length {float(rest.unstretched_length):.4f} m, tension at the foot {float(rest.tension_lower):.0f} N"
)

# %% [markdown]
# The chain is the same cable cut into 40 springs with masses between them. It hangs on the catenary:

# %%
cp.plots.rest(rest, cp.chain.rest(scene));

# %% [markdown]
# ## In motion
#
# Each mass $m$ of the chain obeys Newton's law, equations (1) to (3) of the paper,
#
# $$ m\,\ddot{\mathbf r}_j = \mathbf P_j + \mathbf T_{j+1} - \mathbf T_j, \qquad
#    \mathbf T_j = k \left(1 - \frac{l}{|\mathbf R_j|}\right) \mathbf R_j, \quad
#    \mathbf R_j = \mathbf r_j - \mathbf r_{j-1}, \tag{1-3} $$
#
# with load $\mathbf P$, unstretched length $l$ and stiffness $k = K/l$ of a link; a slack link carries nothing. The time step is
# chosen for you, and the result says which one and what error is left of it:

# %%
chain = cp.chain.simulate(scene, outputs=("position", "velocity", "tension"))
chain

# %%
cp.plots.shapes(chain, times=[0.0, 3.0, 6.3, 9.0, 12.5]);

# %% [markdown]
# All instants lie on one line: the motion is a hundredth of the span. So look at it along the normal of the chord:

# %%
cp.plots.shapes(chain, times=[0.0, 3.0, 6.3, 9.0, 12.5], deflection=True);

# %% [markdown]
# The sag swings by more than half a metre because the upper end moves by 14 cm: a taut cable is a lever.
#
# ## One animation

# %%
movie = cp.plots.animate(chain, deflection=True, frames=4 if SMALL else 60)
movie

# %% [markdown]
# `movie.save("guy.gif")` writes it (`.mp4` with ffmpeg, which `pip install 'cablepod[mp4]'` brings).
#
# ## What the cable pulls

# %%
cp.plots.tension(chain);

# %%
least, most = float(chain.tension.min()), float(chain.tension.max())
print(
    f"tension from {least:.0f} to {most:.0f} N; at rest from {float(rest.tension_lower):.0f} to {float(rest.tension_upper):.0f} N"
)

# %% [markdown]
# This mast only ever sways towards the foot of the guy, whose tension falls below half and comes back. The tension depends
# little on where you look (the weight below adds to it), and strongly on when: waves along the cable run its length in 14
# milliseconds and even it out. That is the idea of the fast model, in *Reduced models*.
#
# Velocity against displacement, of the middle and of a quarter point: the slow loop of the mast, and on it the guy's own
# vibration.

# %%
cp.plots.phase_portraits(chain, at=(0.25, 0.5), coordinate="x");

# %% [markdown]
# ## Keep it
#
# Files are netCDF, with units, and with their history: `cablepod info chain.nc` tells what a file is and how it came about.

# %%
cp.archive.write(chain, "chain.nc", overwrite=True)
print(cp.archive.describe("chain.nc"))

# %% [markdown]
# **Next:** *Modes* (what does this motion consist of?), *Reduced models* (the same, hundreds of times faster), *Parametric
# study* (hundreds of scenes), *The paper*.

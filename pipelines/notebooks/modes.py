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
# # Modes
#
# What do Karhunen-Loève modes of a cable look like, how many are needed, and what does a singular value mean here?

# %%
import os

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod import examples as shipped

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# ## From snapshots to modes
#
# Example 3 of the paper: 125 snapshots of a guy, one a second. Before anything is decomposed, the straight line between the ends
# of the moment is taken off, equation (35),
#
# $$ \mathbf u(\sigma, t) = \mathbf r(\sigma, t) - \bigl[(1 - \sigma)\,\mathbf r_0(t) + \sigma\,\mathbf r_n(t)\bigr],
#    \qquad \sigma = S / L_0, \tag{35} $$
#
# so that what is left vanishes at both ends, whatever they do; then its mean over time. The snapshots of one coordinate are the
# columns of a matrix, and its singular value decomposition, equation (30),
#
# $$ X = \Phi\,\Sigma\,V^{\mathsf T}, \tag{30} $$
#
# gives the modes (columns of $\Phi$) and the singular values.

# %%
scene = shipped.scene("example3")
chain = cp.chain.simulate(scene, tolerance=1e-6, outputs=("position",))
modes = cp.pod.decompose(chain, rank=6)
modes

# %%
cp.plots.modes(modes, count=3);

# %% [markdown]
# The first mode is one bow, the second has a node, the third has two, as the vibrations of a string. But nobody put strings in:
# these are the shapes of this motion. A guy that is driven otherwise has others.
#
# ## What a singular value means
#
# The amplitude of mode $i$ at time $t$ is $a_i(t) = \varphi_i \cdot \mathbf u$, and
#
# $$ \sigma_i^2 = \sum_t a_i(t)^2 : $$
#
# the singular value is the length of the vector of amplitudes, in metres, and $\sigma_i/\sqrt{m}$ is the root mean square of the
# amplitude over $m$ snapshots. Check it:

# %%
amplitude = cp.pod.project(chain, modes).amplitude
length = np.sqrt((amplitude**2).sum("time"))
print("singular values     ", modes.singular_value.sel(coordinate="x").values.round(6))
print("length of amplitudes", length.sel(coordinate="x").values.round(6))
assert np.allclose(length, modes.singular_value, rtol=1e-6)

# %% [markdown]
# Two quantities are easily taken for one another. *Proper orthogonal values* are $\sigma_i^2/m$ [m²]; the *energy share* of a
# mode is $\sigma_i^2 / \sum \sigma^2$. (No energy of mechanics: that would weigh velocities by masses and stretches by
# stiffness.) A share of $\sigma_i / \sum \sigma$ is something else again; see *The paper*.

# %%
cp.plots.singular_values(modes);

# %%
cp.plots.amplitudes(cp.pod.project(chain, modes), count=2);

# %% [markdown]
# ## How many are needed?
#
# Put the motion together again from its first $r$ modes, equation (36), and compare with the chain. No model that lives on $r$
# modes can be better than this.

# %%
ranks = [1, 2, 3, 4, 6]


def projection(run, basis, rank):
    """Error of the run on its first modes."""
    return cp.compare.errors(cp.pod.reconstruct(cp.pod.project(run, basis).isel(mode=slice(rank)), basis), run)


cp.plots.error_over_time({f"r = {rank}": projection(chain, modes, rank) for rank in ranks});

# %% [markdown]
# Each mode more takes the error down by a factor. How fast depends on how the cable is driven. Here are the three moving
# examples of the paper: 2 (taut and slow), 3 (slacker and faster), 4 (a load from the side).

# %%
names = ["example2", "example3"] if SMALL else ["example2", "example3", "example4"]
runs = {name: cp.chain.simulate(shipped.scene(name), tolerance=1e-6, outputs=("position",)) for name in names}
_, ax = plt.subplots(figsize=(6.5, 4), layout="constrained")
for name, colour, line, marker in zip(names, cp.plots.COLOURS, cp.plots.LINES, cp.plots.MARKERS, strict=False):
    basis = cp.pod.decompose(runs[name], rank=8)
    errors = [100 * float(projection(runs[name], basis, rank).error_max) for rank in range(1, 9)]
    ax.semilogy(range(1, 9), errors, color=colour, linestyle=line, marker=marker, label=name)
ax.set(xlabel="number of modes of each coordinate [1]", ylabel="largest error of the projection [%]")
ax.grid(alpha=0.3)
ax.legend();

# %% [markdown]
# ## Normal to the chord
#
# In $x$ and $y$ the cable has two sets of modes, though it has one motion: the deflection normal to its chord. The layout
# "normal" decomposes that alone, and needs one amplitude where "separate" needs two. These modes keep the sag: they hold the
# deflection itself, not only what changes of it, so the first one is mostly the cable at rest. The table has the share of
# $\sum \sigma^2$ that the first modes leave out.

# %%
normal = cp.pod.decompose(chain, rank=6, layout="normal")
cp.plots.modes(normal, count=3);

# %%
shares = xr.Dataset(
    {
        "separate, x": 1 - modes.energy_share.sel(coordinate="x").cumsum("mode"),
        "normal": 1 - normal.energy_share.cumsum("mode"),
    }
)
shares.to_dataframe()[["separate, x", "normal"]].round(9)

# %% [markdown]
# ## How exact are they?
#
# The decomposition says itself what rounding left of its digits. On the route of the paper, Sirovich's method of snapshots, the
# data are squared: singular values below some $10^{-8}$ of the largest are noise.

# %%
for method in ("svd", "snapshots"):
    found = cp.pod.decompose(chain, rank=12, method=method).sel(coordinate="x").isel(mode=-1)
    least, doubt = float(found.singular_value), float(found.singular_value_uncertainty)
    print(f"{method:10} smallest {least:.2e} m, uncertain by {doubt:.0e} m")

# %% [markdown]
# **In short.** Two to eight modes hold the motion of a taut cable, to a per cent or to a part in ten thousand. Whether a *model*
# on these modes moves as the cable does is another question: *Reduced models*.

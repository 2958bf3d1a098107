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
# # The paper, and where its numbers disagree with themselves
#
# Escalante, Faure, Rougier, Rosales and Filipich, *A reduced order model of taut cable dynamics using Karhunen-Loève
# decomposition*, is what this package implements. To implement a paper is to compute its numbers, and some of these contradict
# one another. This page shows which, and what they must have been. The whole report, every table and figure, is made by
# `cablepod paper --out out/paper`.

# %%
import os

import xarray as xr

import cablepod as cp
from cablepod import examples as shipped
from cablepod.paper import examples, figures
from cablepod.paper import table1 as statics

SMALL = bool(os.environ.get("CABLEPOD_SMALL"))

# %% [markdown]
# ## Table 1 has two stiffnesses
#
# A guy at rest, for four tensions $T_1$ at its top. The paper takes the shape of a cable that does not stretch, equations (9) to
# (14) (the print contradicts itself in the signs; these agree),
#
# $$ y(x) = \frac{H}{q}\left[\cosh\!\Bigl(\zeta - \beta\bigl(1 - \tfrac{2x}{a}\bigr)\Bigr) - \cosh(\zeta - \beta)\right], \qquad
#    \beta = \frac{q a}{2 H}, \quad \sinh \zeta = \frac{b}{a}\,\frac{\beta}{\sinh\beta}, \tag{9-11} $$
#
# and then takes off the stretch, equations (15) and (16):
#
# $$ L_0 = L - \frac{1}{K} \int_0^L T\,\mathrm ds. \tag{16} $$
#
# By the data $K = E\Omega = 2\cdot 10^7$ N. Here is the printed $L_0$ beside eq. (16) with that $K$, and with a hundredth of it:

# %%
table = statics.table1()
linear = table.table1_unstretched_length.sel(procedure="linearised", drop=True)
lengths = xr.Dataset(
    {
        "T1 [N]": table.table1_top_tension,
        "L0 printed [m]": table.table1_unstretched_length_printed,
        "with K": linear.isel(table1_stiffness=0, drop=True),
        "with K/100": linear.isel(table1_stiffness=1, drop=True),
    }
)
lengths.drop_vars(set(lengths.coords)).to_dataframe().round(4)

# %% [markdown]
# The first row is computed with $K$, but for one in the last digit printed; the others with $K/100$, to that digit. With $K$ the
# guy stretches by centimetres at most, with $K/100$ by metres, where the linearisation of eq. (16) no longer holds.

# %%
cp.plots.rest(cp.catenary.rest(shipped.scene("example1")), cp.chain.rest(shipped.scene("example1")));

# %% [markdown]
# ## The lengths of Examples 3 and 4 are swapped
#
# Example 3 is printed with $T_1 = 3750$ N and $L_0 = 58.9937$ m, Example 4 with 7500 N and 60.1479 m. Look in the table above:
# they have each other's length. Neither can be had with $K = E\Omega$, nor can that of Example 2: so short a rope between these
# ends would be under a tension, at its top, of

# %%
for name in ("example2", "example3", "example4"):
    printed = cp.catenary.rest(shipped.scene(f"{name}_as_printed"))
    ours = cp.catenary.rest(shipped.scene(name))
    text = f"L0 as printed {float(printed.unstretched_length):.4f} m: {float(printed.tension_upper) / 1e3:.0f} kN at the top"
    print(f"{name}: {text}; T1 as printed: {float(ours.unstretched_length):.4f} m")

# %% [markdown]
# which is fifty to two hundred times what the paper says. The shipped scenes keep $T_1$ and let the length follow.
#
# ## Table 2 lists singular values, not proper orthogonal values
#
# The paper defines proper orthogonal values as eigenvalues of the covariance matrix, equation (29),
#
# $$ C = \tfrac1m X X^{\mathsf T}, \qquad C \varphi_i = \lambda_i \varphi_i, \qquad \lambda_i = \sigma_i^2 / m, \tag{29} $$
#
# and heads Table 2 with that name. Compute both, from equilibrium and from the start of which below:

# %%
starts = list(examples.STARTS)[: 3 if SMALL else None]
found = examples.table2(starts=starts)
rest = found.sel(start="example2").isel(table2_row=0)
print("printed           x, y:", found.table2_singular_value_printed.isel(table2_row=0).values)
print("sigma        [m]  x, y:", rest.table2_singular_value.values.round(4))
print("sigma^2 / m [m2]  x, y:", rest.table2_proper_orthogonal_value.values.round(4))

# %% [markdown]
# The ratio of the two columns settles it: it would be the square for proper orthogonal values.

# %%
printed = found.table2_singular_value_printed.isel(table2_row=0).values
sigma, proper = rest.table2_singular_value.values, rest.table2_proper_orthogonal_value.values
print(
    f"x over y: printed {printed[0] / printed[1]:.3f}, sigma {sigma[0] / sigma[1]:.3f}, sigma^2/m {proper[0] / proper[1]:.2f}"
)

# %% [markdown]
# Its percentages are $\sigma_i / \sum \sigma$, cumulated, though the text speaks of energy, which would be
# $\sigma_i^2 / \sum \sigma^2$.
#
# ## The chain did not start from equilibrium
#
# The first row nearly agrees; the others do not. From equilibrium the motion is nearly quasi-static, and the second singular
# value is three centimetres in x, where the paper has twenty:

# %%
figures.singular_values(found);

# %% [markdown]
# Start the chain from the shape of a cable that is a little longer or shorter than it should be, and it vibrates about its slow
# motion: then several rows of the table come out. Which start it was the table cannot say; more than one explains it (the report
# tries many).

# %%
misfit = found.table2_misfit.to_series().rename("rms of ln(ours / print)")
misfit.round(3)

# %% [markdown]
# ## What the reduced model is worth
#
# The paper judges its model by the look of one instant, 45 s. Here are Example 3's chain and its model on two modes of each
# coordinate:

# %%
item = examples.study("example3")
model = cp.galerkin.simulate(item.scene, item.modes, rank=2, tolerance=1e-5)
cp.plots.shapes(item.chain, model, times=[0.0, 15.0, 45.0, 90.0], deflection=True);

# %%
ranks = (1, 2) if SMALL else (1, 2, 4, 8)
runs = {f"r = {r}": cp.galerkin.simulate(item.scene, item.modes, rank=r, tolerance=1e-5) for r in ranks}
errors = {name: cp.compare.errors(run, item.chain) for name, run in runs.items()}
cp.plots.error_over_time(errors);

# %%
for name, error in errors.items():
    print(f"{name}: largest error {float(error.error_max):.2%}, at 45 s {float(error.error.sel(time=45.0)):.2%}")

# %% [markdown]
# One instant flatters or blames; the largest error over time is what this package reports.
#
# ## The sign of the side load
#
# Example 4 adds a horizontal load $q_h = 1.5\,\gamma_0 \Omega$. What is left of equation (18a) in print has it towards $-x$; the
# figures do not say. It matters: one way the load presses the guy down, the other way it lifts it.

# %%
sides = {"+x": shipped.scene("example4"), "-x": shipped.scene("example4_opposite_load")}
for side, scene in sides.items():
    at_rest = cp.catenary.rest(scene)
    length, foot = float(at_rest.unstretched_length), float(at_rest.tension_lower)
    print(f"towards {side}: L0 = {length:.6f} m, tension at the foot {foot:.0f} N")

# %%
ax = None
for scene in sides.values():
    ax = cp.plots.shapes(cp.chain.simulate(scene), times=[0.0, 45.0], deflection=True, ax=ax)
ax.set_title("Example 4: load towards +x below, towards -x above");

# %% [markdown]
# `data/README.md` lists every repair, and why; `cablepod paper` sets every table and figure of the paper beside ours.

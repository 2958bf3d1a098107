"""Draw Example 3, Table 2, and the range of validity of the chain's modes.

    python pipelines/paper_figures.py [--out FOLDER]

Writes example3.png, table2.png and validity.png, by default to pipelines/figures.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

from _study import command_line
from matplotlib import pyplot as plt

import cablepod as cp
from cablepod.examples import scene
from cablepod.paper import examples, figures, validity

HERE = Path(__file__).resolve().parent


def example3() -> plt.Figure:
    """Draw Example 3: chain as dots, Galerkin model as lines, and the error over time."""
    given = scene("example3")
    chain = cp.chain.simulate(given, tolerance=1e-6, outputs=("position",))
    modes = cp.pod.decompose(chain, rank=8)
    models = {f"r = {rank}": cp.galerkin.simulate(given, modes, rank=rank) for rank in (1, 2, 4, 8)}
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), layout="constrained")
    cp.plots.shapes(chain, models["r = 2"], times=[0.0, 15.0, 45.0, 90.0], deflection=True, ax=left)
    cp.plots.error_over_time({name: cp.compare.errors(run, chain) for name, run in models.items()}, ax=right)
    left.set_title("Example 3: the guy at four instants")
    right.set_title("Galerkin model against the chain")
    return figure


def main(folder: Path) -> None:
    """Write the figures into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    example3().savefig(folder / "example3.png", dpi=90)
    figures.singular_values(examples.table2()).savefig(folder / "table2.png", dpi=75)
    figures.validity(validity.maps()).savefig(folder / "validity.png", dpi=75)


if __name__ == "__main__":
    main(command_line(__doc__, out=HERE / "figures").parse_args().out)

"""Draw the picture of the README: Example 3, chain as dots, Galerkin model as lines.

python pipelines/example_figure.py [pipelines/figures/example3.png]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

from matplotlib import pyplot as plt

import cablepod as cp

HERE = Path(__file__).resolve().parent


def main(target: Path) -> None:
    """Write the picture to `target`."""
    scene = cp.read_scene(HERE.parent / "data" / "scenes" / "example3.toml")
    chain = cp.chain.simulate(scene)
    modes = cp.pod.decompose(chain, rank=8)
    models = {f"r = {rank}": cp.galerkin.simulate(scene, modes, rank=rank) for rank in (1, 2, 4, 8)}
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), layout="constrained")
    cp.plots.shapes(chain, models["r = 2"], times=[0.0, 15.0, 45.0, 90.0], deflection=True, ax=left)
    cp.plots.error_over_time({name: cp.compare.errors(run, chain) for name, run in models.items()}, ax=right)
    left.set_title("Example 3: the guy at four instants")
    right.set_title("Galerkin model against the chain")
    figure.savefig(target, dpi=90)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "figures" / "example3.png")

"""What the modes of a condensed model lack of the deflection at rest."""

from __future__ import annotations

import numpy as np

from cablepod.chain._start import rest_shape
from cablepod.condensed._model import CondensedModel
from cablepod.discretisation._chord_frame import ChordFrame

#: Part of the deflection at rest beyond which modes miss it: two vibration modes of a taut guy, 4 %, have good responses.
MISSING_SAG = 0.05


def _rest_deflection(model: CondensedModel) -> np.ndarray:
    """Return the deflection of the chain at rest (normals, particle) [m]."""
    position = rest_shape(model.chain)[0]
    return ChordFrame.of((position[-1] - position[0])[None], model.reference).split(position[None])[1][:, 0]


def sag_over_chord(model: CondensedModel) -> float:
    """Return the largest deflection at rest over the distance of the ends."""
    chord = np.linalg.norm(np.diff(model.chain.p.initial_ends, axis=0))
    return float(np.sqrt((_rest_deflection(model) ** 2).sum(axis=0)).max() / chord)


def missing_sag(model: CondensedModel) -> str:
    """Return what the modes lack of the deflection at rest, in words; empty for those that hold it."""
    root = np.sqrt(model.mass)
    sag, left = _rest_deflection(model) * root, 0.0
    for part, which in zip(sag, model.sets, strict=True):
        basis = np.linalg.qr((model.shapes[which] * root).T)[0]
        left += float(np.sum((part - basis @ (basis.T @ part)) ** 2))
    missing = float(np.sqrt(left / max(float(np.sum(sag**2)), 1e-300)))
    if not missing > MISSING_SAG:
        return ""
    count = f"{model.n_in_plane} mode{'s' if model.n_in_plane > 1 else ''}"
    return f"{count} in the plane, without {100.0 * missing:.2g} % of the deflection at rest"

"""Dampers and springs in the error estimate: their forces on the enriched model, along slopes of the motion instead of rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cablepod.condensed._attached import chordwise_motion, has_load, place_of, shape_along
from cablepod.condensed._coefficients import Coefficients
from cablepod.discretisation._chord_frame import ChordFrame

if TYPE_CHECKING:
    from cablepod.condensed._model import CondensedModel


def forces_of_attachments(
    enriched: Coefficients,
    model: CondensedModel,
    change: np.ndarray,
    q: np.ndarray,
    rates: np.ndarray,
    boundary_data: np.ndarray,
) -> np.ndarray:
    """Return the forces of dampers and springs on the enriched coordinates beyond those to leading order (samples, R).

    An attachment moves by u = (d.n) w + (d.e) eta along its direction, where eta is the chordwise motion by -w'^2 / 2; its force
    acts on the coordinates by the derivatives of u.  The model has these at the slopes of rest.

    Parameters
    ----------
    enriched, model
        Enriched model, and that of the motion.
    change
        Matrix from the coordinates of the motion to the enriched ones (R, r).
    q, rates, boundary_data
        Coordinates of the motion, their rates (samples, r), and boundary data (samples, columns).
    """
    chain, p = model.chain, model.chain.p
    frame, length = ChordFrame.of(np.diff(p.initial_ends, axis=0), model.reference), chain.length
    patterns, rest = len(model.load_patterns), model.rest_of_springs
    column = 1 + 2 * patterns - len(model.attached_shapes)
    forces = np.zeros((len(q), len(change)))
    for attachment, fraction in zip(p.attachments, chain.attached_fractions, strict=True):
        if not (attachment.damper or attachment.spring):
            continue
        place, d = place_of(chain, fraction), np.asarray(attachment.direction)
        along, by_link = d @ frame.along[0], chordwise_motion(chain, np.eye(chain.links), place)
        psi, at_rest = shape_along(model, attachment, fraction), shape_along(enriched, attachment, fraction)
        load = np.zeros(len(q))
        if has_load(p, attachment):
            load, column = boundary_data[:, column], column + 1
        moved, rate, derivatives = np.zeros(len(q)), np.zeros(len(q)), np.empty_like(forces)
        for which, own, normal in zip(model.sets, enriched.sets, frame.normals[0], strict=True):
            part, slopes = (d @ normal) * (model.shapes[which] @ place), model.slopes[which]
            slope, slope_rate, slope_rest = q[:, which] @ slopes, rates[:, which] @ slopes, rest[which] @ slopes
            moved += (q - rest)[:, which] @ part + along * (0.5 * (slope**2 - slope_rest**2) * length) @ by_link
            rate += rates[:, which] @ part + along * (slope * slope_rate * length) @ by_link
            derivatives[:, own] = (d @ normal) * (enriched.shapes[own] @ place)
            derivatives[:, own] += along * (slope * length * by_link) @ enriched.slopes[own].T
        force = load - attachment.spring * (psi @ rest + moved) - attachment.damper * rate
        in_equation = load - attachment.spring * (q @ change.T @ at_rest)
        forces += force[:, None] * derivatives - in_equation[:, None] * at_rest
    return forces

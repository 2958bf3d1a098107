"""Dampers and springs in the error estimate: their forces on the enriched model, at slopes and chord of the motion."""

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
    times: np.ndarray,
    q: np.ndarray,
    rates: np.ndarray,
    boundary_data: np.ndarray,
) -> np.ndarray:
    """Return the forces of dampers and springs on the enriched coordinates beyond those to leading order (samples, R).

    An attachment moves by u = (d.n) w + (d.e) eta along its direction, where eta is the chordwise motion by -w'^2 / 2; its force
    acts on the coordinates by the derivatives of u.  The model has these at the slopes and for the chord of rest.

    Parameters
    ----------
    enriched, model
        Enriched model, and that of the motion.
    change
        Matrix from the coordinates of the motion to the enriched ones (R, r).
    times
        Instants of the samples [s].
    q, rates, boundary_data
        Coordinates of the motion, their rates (samples, r), and boundary data (samples, columns).
    """
    chain, p = model.chain, model.chain.p
    frame_at_rest = ChordFrame.of(np.diff(p.initial_ends, axis=0), model.reference)
    reach, reach_rate = (np.diff(p.end_positions(times, derivative), axis=1)[:, 0] for derivative in (0, 1))
    frame = ChordFrame.of(reach, model.reference)
    turning = frame.rates(reach, reach_rate)[1:]
    length, patterns, rest = chain.length, len(model.load_patterns), model.rest_of_springs
    column = 1 + 2 * patterns - len(model.attached_shapes)
    forces = np.zeros((len(q), len(change)))
    for attachment, fraction in zip(p.attachments, chain.attached_fractions, strict=True):
        if not (attachment.damper or attachment.spring):
            continue
        place, d = place_of(chain, fraction), np.asarray(attachment.direction)
        by_link = chordwise_motion(chain, np.eye(chain.links), place)
        # d.e, and d.n of each deflection: at rest, of the samples (samples,), and their rates
        of_chord = (frame_at_rest.along @ d)[0], frame.along @ d, turning[0] @ d
        of_normals = ((array @ d).T for array in (frame_at_rest.normals, frame.normals, turning[1]))
        psi, at_rest = shape_along(model, attachment, fraction), shape_along(enriched, attachment, fraction)
        load = np.zeros(len(q))
        if has_load(p, attachment):
            load, column = boundary_data[:, column], column + 1
        moved, rate, derivatives = np.zeros(len(q)), np.zeros(len(q)), np.empty_like(forces)
        for which, own, *of_normal in zip(model.sets, enriched.sets, *of_normals, strict=True):
            shape, slopes = model.shapes[which] @ place, model.slopes[which]
            slope, slope_rate, slope_rest = q[:, which] @ slopes, rates[:, which] @ slopes, rest[which] @ slopes
            of_slopes = length * by_link
            eta, eta_rate = 0.5 * slope**2 @ of_slopes, (slope * slope_rate) @ of_slopes
            w, w_rate = q[:, which] @ shape, rates[:, which] @ shape
            moved += of_normal[1] * w + of_chord[1] * eta
            moved -= of_normal[0] * (rest[which] @ shape) + of_chord[0] * (0.5 * slope_rest**2 @ of_slopes)
            rate += of_normal[1] * w_rate + of_normal[2] * w + of_chord[1] * eta_rate + of_chord[2] * eta
            derivatives[:, own] = np.outer(of_normal[1], enriched.shapes[own] @ place)
            derivatives[:, own] += of_chord[1][:, None] * ((slope * of_slopes) @ enriched.slopes[own].T)
        force = load - attachment.spring * (psi @ rest + moved) - attachment.damper * rate
        in_equation = load - attachment.spring * (q @ change.T @ at_rest)
        forces += force[:, None] * derivatives - in_equation[:, None] * at_rest
    return forces

"""Drag of the air on the mast: that of the mean wind on each element, carried by its nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cablepod.catenary._end_stiffness import gauss_rule
from cablepod.mast._beam import DRAG_AREA, Beam, hermite
from cablepod.parameters._mast import MastParameters
from cablepod.parameters._parameters import ramp_of
from cablepod.wind._air import density_of, mean_velocity
from cablepod.wind._mast_air import MastAir

#: Gauss points of an element: drag in a power profile that begins at its lower end to 1e-3, elsewhere to 1e-8.
GAUSS_POINTS = 8
#: Drag area [m2/m] and square of a speed [m2/s2] in place of 0, where loads on elements without drag are shared among nodes.
NONE = 1e-100


@dataclass(frozen=True, eq=False)
class MastDrag:
    """Mean wind and drag at the nodes, and the loads on the elements that the drag at a node stands for.

    The foot carries none, as it does not move: the lowest element has the air of its upper node.
    """

    beam: Beam
    velocity: np.ndarray  #: of a uniform wind with the drag of the mean wind on what the node carries (nodes, 2) [m/s]
    gusts: np.ndarray  #: weights of velocities at `heights` in the drag on a node, of sum 1 (nodes, heights)
    heights: np.ndarray  #: points of quadrature of the elements (heights,) [m]
    areas: np.ndarray  #: drag coefficient times area that each node carries (nodes,) [m2]
    at_rest: np.ndarray  #: drag from which runs start, 0 with a ramp (nodes, 2) [N]
    #: forces and moments at the ends of an element, by a drag of one on its lower, upper node (elements, 2, 4)
    loads: np.ndarray

    @cached_property
    def _single(self) -> np.ndarray:
        """Loads on the elements by the drag on the nodes, of one direction (elements, 4, nodes)."""
        result = np.zeros((self.beam.length.size, 4, self.beam.height.size))
        for e, own in enumerate(self.loads):
            result[e, :, e : e + 2] = own.T
        return result

    @cached_property
    def rows(self) -> np.ndarray:
        """Load of the drag on the unknowns, and mean displacement of what a node carries, by them (nodes, 2, count)."""
        single = np.zeros((self.beam.height.size, 2 * self.beam.height.size))
        for e, own in enumerate(self._single):
            single[:, 2 * e : 2 * e + 4] += own.T
        return self.beam.along_both(single)

    @cached_property
    def section_rows(self) -> np.ndarray:
        """Section forces by the drag on the nodes, the unknowns held, of one direction (node + element ends, nodes)."""
        return self.beam.sections_of_loads(self._single)


def drag_of_mast(p: MastParameters, beam: Beam, air: MastAir | None) -> MastDrag:
    r"""Integrate the drag of the mean wind over each element.

    With hats h_n of the nodes, drag area c per length and mean wind U(y), the velocity V_n at a node gives

    .. math:: |V_n| V_n \int c h_n dy = \int c h_n |U| U dy,

    and its drag acts as that under the integral does.  The wind at the node itself would miss drag near the ground, where a
    profile falls to 0.  Gusts u change the drag by 2 c |U| u, which weights their mean over what a node carries.

    Parameters
    ----------
    p, beam
        Scene and its mesh.
    air
        Whose mean is that of a record or field; None for the profile of [wind], or still air.
    """
    upper, weights = gauss_rule(GAUSS_POINTS)
    heights = beam.height[:-1, None] + beam.length[:, None] * upper
    rises = bool(ramp_of(p) if air is None else air.ramp)
    if air is not None and not air.has_profile:
        velocity = (air.weights_at(heights.ravel()) @ air.of_mast(air.mean)).reshape(*heights.shape, 2)
    elif p.wind is not None:
        velocity = mean_velocity(p, heights)[..., [0, 2]]
    else:
        velocity = np.zeros((*heights.shape, 2))
    hats = np.repeat(np.stack([1.0 - upper, upper])[None], beam.length.size, axis=0)  # (element, end, point)
    hats[0] = [0.0 * upper, 1.0 + 0.0 * upper]
    area = hats * (np.maximum(beam.section[:, DRAG_AREA], NONE) * beam.length)[:, None, None] * weights
    speed = np.linalg.norm(velocity, axis=-1)
    drag = area * np.maximum(speed**2, NONE)[:, None]
    shapes = np.array([hermite(upper, length, 0) for length in beam.length.tolist()])
    by_gusts = np.zeros((*hats.shape[:2], *heights.shape))
    for e, own in enumerate(area * np.maximum(speed, NONE)[:, None]):
        by_gusts[e, :, e] = own
    gusts = _on_nodes(by_gusts.reshape(*hats.shape[:2], -1))
    gusts /= np.maximum(gusts.sum(axis=1, keepdims=True), NONE * NONE * NONE)
    areas, drags, vectors = (
        _on_nodes(own) for own in (area.sum(axis=-1), drag.sum(axis=-1), area @ (speed[..., None] * velocity))
    )
    mean = vectors / np.maximum(areas, NONE * NONE)[:, None]
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    mean /= np.sqrt(np.where(size > 0.0, size, 1.0))
    at_rest = np.zeros_like(mean) if rises else 0.5 * (density_of(p) if air is None else air.density) * vectors
    carried = np.stack([drags[:-1], drags[1:]], axis=1)[..., None]
    loads = np.divide(
        drag @ np.swapaxes(shapes, 1, 2), carried, out=np.zeros((*drag.shape[:2], 4)), where=carried > 0.0
    )
    return MastDrag(beam, mean, gusts, heights.ravel(), areas, at_rest, loads)


def _on_nodes(ends: np.ndarray) -> np.ndarray:
    """Return the sums at the nodes of values at the ends of elements (elements, 2, ...)."""
    result = np.zeros((len(ends) + 1, *ends.shape[2:]))
    result[:-1] += ends[:, 0]
    result[1:] += ends[:, 1]
    return result

"""Ice: a round coat on a cable or on the members of a mast, grown after tensioning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cablepod.errors import SceneError
from cablepod.parameters._keys import ICE
from cablepod.parameters._parameters import Parameters
from cablepod.parameters._scene_values import whole


def coat_section(thickness: Any, diameter: Any) -> Any:
    """Return the section of a round coat of a thickness [m] on a diameter [m], pi t (d + t) [m2]."""
    return np.pi * thickness * (diameter + thickness)


def iced(p: Parameters, tables: Mapping[str, Any], path: str, number: Callable[[Any], Any]) -> Parameters:
    """Return a cable with the ice of its scene; `path` is that of its table."""
    ice = whole("ice", tables.get("ice", {}), ICE)
    if not ice:
        return p
    if p.diameter is None:
        raise SceneError(f"{path}.diameter: missing; allowed: a diameter [m], on which the ice grows")
    thickness = number(ice["thickness"])
    if not np.any(thickness):
        return p
    mass = number(ice["density"]) * coat_section(thickness, p.diameter)
    weight = p.weight.copy()
    weight[..., 1] -= mass * number(tables["gravity"])
    return replace(p, mass=p.mass + mass, weight=weight, diameter=p.diameter + 2.0 * thickness, bare=p.bare or p)


def ice_thickness(p: Parameters) -> Any:
    """Return the thickness of the ice on a cable [m]."""
    return 0.0 if p.bare is None or p.diameter is None else 0.5 * (p.diameter - p.bare.diameter)


def mass_of_ice(p: Parameters) -> Any:
    """Return the mass of the ice per unstretched length of a cable [kg/m]."""
    return 0.0 if p.bare is None else p.mass - p.bare.mass / p.expansion

r"""Thermal expansion: lengths at the temperature of a scene over those at its reference temperature.

A cable of the unstretched length :math:`L_0(\theta_0)`, at which its tension, sag or length is given, has

.. math:: L_0(\theta) = L_0(\theta_0)\,(1 + \alpha(\theta - \theta_0))

with its mass :math:`\mu L_0` and its stiffness EA kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cablepod.errors import scene_error
from cablepod.parameters._parameters import Parameters

#: Reference temperature where none is given [degC].
REFERENCE = 20.0
#: Keys of the temperatures of a scene.
TEMPERATURES = ("temperature", "reference_temperature")


def temperatures_of(values: Mapping[str, Any], number: Callable[[Any], Any] = float) -> tuple[Any, Any] | None:
    """Return temperature and reference temperature of a scene [degC] by its values; None where it gives neither."""
    if not any(name in values for name in TEMPERATURES):
        return None
    reference = number(values.get("reference_temperature", REFERENCE))
    return number(values["temperature"]) if "temperature" in values else reference, reference


def expansion_of(
    values: Mapping[str, Any], table: Mapping[str, Any], path: str, number: Callable[[Any], Any] = float
) -> Any:
    """Return the length of a cable or mast over that at the reference temperature; None without a temperature.

    Parameters
    ----------
    values
        Values of scene variables by name.
    table
        Table of the cable or mast, with its coefficient.
    path
        Key path of the table, for messages.
    number
        Converts the values.

    Raises
    ------
    SceneError
        For a temperature of what has no coefficient; the message names its key.
    """
    given = [name for name in TEMPERATURES if name in values]
    if given and "thermal_expansion" not in table:
        allowed = f"none without {path}.thermal_expansion [1/K], 0 where it does not expand"
        raise scene_error(given[0], np.asarray(values[given[0]]).flat[0], allowed)
    temperatures = temperatures_of(values, number)
    if temperatures is None or "temperature" not in values:
        return None
    temperature, reference = temperatures
    return 1.0 + number(table["thermal_expansion"]) * (temperature - reference)


def expanded(p: Parameters, expansion: Any) -> Parameters:
    """Return a cable at its temperature; `p` is that at the reference temperature, to which what is given belongs."""
    if expansion is None or not np.any(np.not_equal(expansion, 1.0)):
        return p
    is_length = p.length_key == "unstretched_length"
    return replace(
        p,
        mass=p.mass / expansion,
        weight=p.weight / np.asarray(expansion)[..., None],
        length_value=p.length_value * expansion if is_length else p.length_value,
        expansion=expansion,
        bare=p,
    )

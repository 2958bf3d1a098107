"""Compiled moduli of links by both laws."""

from __future__ import annotations

from cablepod._jit import compiled


@compiled
def green_strain(load):
    """Solve xi (xi^2 - 1)/2 = load for the strain xi - 1 of law (21); `load` is tension over stiffness.

    With e = xi - 1 the equation reads e (1 + e) (1 + e/2) = load.  The left side is convex and increasing, so that Newton's
    method from e = load decreases monotonically to the solution, without cancellation for small strains.
    """
    e = load
    for _ in range(60):
        e_next = e - (e * (1.0 + e) * (1.0 + 0.5 * e) - load) / (1.0 + 3.0 * e + 1.5 * e * e)
        if not e_next < e:
            break
        e = e_next
    return e


@compiled
def secant_modulus(tension, stiffness, green):
    """Return tension over strain of a link [N]: K, by law (21) K (1 + e) (1 + e/2)."""
    if not green:
        return stiffness
    e = green_strain(tension / stiffness)
    return stiffness * (1.0 + e) * (1.0 + 0.5 * e)


@compiled
def secant_moduli(tensions, stiffness, green, out):
    """Fill `out` (links,) with the :func:`secant_modulus` of each link, of an axial stiffness (links,) [N]."""
    for j in range(tensions.size):
        out[j] = secant_modulus(tensions[j], stiffness[j], green)

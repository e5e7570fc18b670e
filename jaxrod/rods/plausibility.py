"""Numbers that no rod has in SI, and the slip of units that would explain them.

Numbers of another consistent system of units are right and draw no warning: the equations hold in any.
"""

from typing import Any

import numpy as np

_FASTEST, _STIFFEST = 2.0e4, 1.5e12  # m/s, Pa: diamond has 1.8e4 and 1.2e12
_LIGHTEST, _SLOW = 1.0, 1e3  # kg/m^3, m/s: nothing lighter than air carries sound faster
# Young's modulus in Pa below which a solid of this density in kg/m^3, or more, is too soft to be one: gels, filled
# rubber, lead.
_SOFTEST = ((500.0, 20.0), (1400.0, 1e3), (2000.0, 1e6), (6000.0, 1e9), (1e6, np.inf))
# Densities in kg/m^3, from and to, and moduli in Pa of solids: wood; rubber and plastics, fibres; composites; glass and
# light metals; metals.
_SOLIDS = (
    (400.0, 900.0, 1e5, 3e11),
    (900.0, 1200.0, 1e5, 6e9),
    (900.0, 1200.0, 3e10, 3e11),
    (1200.0, 1500.0, 1e5, 3e11),
    (1500.0, 3000.0, 3e8, 1e12),
    (3000.0, 23000.0, 1e10, 1.3e12),
)
# In cgs alone a density in g/cm^3 beside SI looks like a solid a tenth as stiff; these are not.
_SOLIDS_CGS = (
    (400.0, 1500.0, 1e5, 1e8),
    (400.0, 900.0, 3.5e8, 3e11),
    (900.0, 1200.0, 3.5e8, 6e9),
    (900.0, 1200.0, 3e10, 3e11),
    (1200.0, 1500.0, 3.5e8, 3e11),
    (1500.0, 3000.0, 2e10, 1e12),
    (3000.0, 23000.0, 3.5e10, 1.3e12),
)
_PSI, _PCI = 6894.757, 27679.90  # lbf/in^2 in Pa, lb/in^3 in kg/m^3
# Units of stress and density of consistent systems in SI.
_CONSISTENT = (
    (1e6, 1e12),  # mm, tonne, s
    (1e9, 1e9),  # mm, kg, ms
    (1e6, 1e6),  # mm, g, ms
    (1e3, 1e9),  # mm, kg, s
    (1e-3, 1e3),  # mm, mg, s
    (1e3, 1e3),  # m, tonne, s
    (1e6, 1e18),  # um, kg, s
    (_PSI, 1.068688e7),  # inch, pound, s
    (47.88026, 515.3788),  # foot, slug, s
    (1.488164, 16.01846),  # foot, pound of mass, s
)
_CGS = (0.1, 1e3)
_YOUNG = {"GPa": 1e9, "MPa": 1e6, "psi": _PSI, "ksi": 1e3 * _PSI, "kPa": 1e3, "dyn/cm^2": 0.1}
_DENSITY = {"g/cm^3": 1e3, "kg/mm^3": 1e9, "t/mm^3": 1e12, "lb/in^3": _PCI, "g/m^3": 1e-3}
_RUBBER = (5e6, 1e8)  # Pa
_NAMED = 2  # slips that explain the same numbers
_HEAVIEST = 1e8  # kg: four times a cable of the longest suspension bridge
_LONGEST_IN_MM = 1e5  # a length in mm beyond which it is no rod by itself
_LARGEST_STRAIN = 15.0  # beyond which nobody means Hooke's law: a metre of jelly that swings reaches 13.5


def material(young: np.ndarray, density: np.ndarray) -> str:
    """A question on the first point along the rod whose numbers are of no solid, in no consistent system of units."""
    with np.errstate(all="ignore"):
        speed = np.sqrt(young / density)
    odd = (speed > _FASTEST) | (young > _STIFFEST) | (density < _LIGHTEST) & (speed > _SLOW)
    for dense, least in _SOFTEST:
        odd |= (density >= dense) & (young < least)
    if not np.any(odd):
        return ""
    E, rho = (float(x[np.argmax(odd)]) for x in (young, density))
    if any(_is_solid(E * stress, rho * mass, _SOLIDS) for stress, mass in _CONSISTENT):
        return ""
    if _is_solid(E * _CGS[0], rho * _CGS[1], _SOLIDS_CGS):
        return ""
    what = "beyond any solid (diamond 1.8e4 m/s)" if _FASTEST**2 * rho < E else "of no solid of that density"
    asked = f"wave speed sqrt(young/density) = {np.sqrt(E / rho):.3g} m/s is {what}: "
    return f"{asked}is young={E:.6g} in Pa and density={rho:.6g} in kg/m^3?{_slip(E, rho)}"


def _is_solid(E: float, rho: float, solids: Any) -> bool:
    return _FASTEST**2 * rho >= E and any(a <= rho <= b and low <= E <= high for a, b, low, high in solids)


def _slip(E: float, rho: float) -> str:
    """The unit, or two, that would make a solid of it."""
    if _RUBBER[0] <= E * 1e-6 <= _RUBBER[1] and _is_solid(E * 1e-6, rho, _SOLIDS):
        return " (The paper prints rubber's modulus as 10^7 MPa where 10^7 Pa is meant.)"
    stresses, densities = {"": 1.0, **_YOUNG}, {"": 1.0, **_DENSITY}
    fits = [(a, b) for a in stresses for b in densities if _is_solid(E * stresses[a], rho * densities[b], _SOLIDS)]
    fewest = min((bool(a) + bool(b) for a, b in fits), default=0)
    said = []
    for a, b in [(a, b) for a, b in fits if bool(a) + bool(b) == fewest][:_NAMED]:
        young = [f"young in {a} (give {E * stresses[a]:.4g})"] if a else []
        density = [f"density in {b} (give {rho * densities[b]:.4g})"] if b else []
        said.append(" and ".join(young + density))
    return f" It looks like {', or '.join(said)}." if said else ""


def mass(length: float, s: np.ndarray, area: np.ndarray, density: np.ndarray) -> str:
    """A question on a rod that is heavier than any, as one of lengths in mm is."""
    heavy = float(np.trapezoid(area * density, s)) * length / (s[-1] - s[0])
    if heavy < _HEAVIEST or length > _LONGEST_IN_MM or np.min(density) < _SOLIDS[0][0]:
        return ""
    asked = f"the rod weighs {heavy:.3g} kg: are length={length:.6g} and its section in m?"
    return f"{asked} In mm it would weigh {1e-9 * heavy:.3g} kg."


def strain(largest: float, young: Any) -> str:
    """A question on a run that stretched a rod by Hooke's law beyond all that it is for."""
    if not largest > _LARGEST_STRAIN:
        return ""
    return (
        f"the strain reaches {largest:.3g}, where no rod follows Hooke's law: is young={young} in Pa, and the rest in SI? "
        "A rod so soft wants Rod(law=...)."
    )

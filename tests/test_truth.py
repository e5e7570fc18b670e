"""Every case of truth.json, computed elsewhere (sympy, mpmath, Taylor series of 45 digits), through the public API.

Tolerances are relative to the natural scale of the quantity: the length for positions, 1 for strains, 1 rad or the
largest angle, the largest rate (of a strain: the natural rate, which is a strain of 1 in vibration), the largest of
T + elastic + |gravity|.
"""

import dataclasses
import functools
import json
import math
import pathlib

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.optimize

import jaxrod

CASES = json.loads((pathlib.Path(__file__).parent / "truth.json").read_text())["cases"]
STARTS = ("omega0", "psi0", "eps0", "deps0")
MATERIAL = ("E", "rho", "r_pivot", "r_tip", "l0")

# tolerance of simulate -> bound on the error over the natural scale; None is the default tolerance
accuracies = pytest.mark.parametrize("tolerance, bound", [(None, 1e-8), (1e-12, 1e-11)], ids=["default", "tight"])


def cases(*kinds):
    chosen = [case for case in CASES if case["kind"] in kinds]
    return pytest.mark.parametrize("case", chosen, ids=[case["name"] for case in chosen])


def case_named(name):
    return next(case for case in CASES if case["name"] == name)


def test_no_case_is_forgotten():
    tested = {
        "paper_error", "paper_error_9b", "geometry", "planar_pivot", "spherical", "free_planar", "swinging_spring",
        "collapse", "near_collapse", "sensitivities", "pde_frequencies", "frequency_sensitivities",
    }  # fmt: skip
    assert {case["kind"] for case in CASES} == tested


# ---- from the inputs of a case to a scene


def rod_of(i):
    thin = 1.0 if "l0" in i else 1e-5  # where no length is given only the ratio of the radii matters
    section = jaxrod.Cone(root_radius=thin * i["r_pivot"], tip_radius=thin * i["r_tip"])
    return jaxrod.Rod(length=i.get("l0", 1.0), section=section, young=i.get("E", 1.0), density=i.get("rho", 1.0))


def mixture_of(i, lever="x_C"):
    """The paper's mixture: stiffness (14) of a constant force, inertia (16) of a uniform strain, arm l0/2 or x_C."""
    r, R, l0 = i["r_pivot"], i["r_tip"], i.get("l0", 1.0)
    square = R**2 + R * r + r**2
    mass = i.get("rho", 1.0) * math.pi * l0 * square / 3
    inertia = mass * l0**2 / 10 * (6 * R**2 + 3 * R * r + r**2) / square
    x_C = l0 / 2 if lever.startswith("l0/2") else l0 / 4 * (3 * R**2 + 2 * R * r + r**2) / square
    return jaxrod.Lumped(inertia, mass * x_C, math.pi * r * R * i.get("E", 1.0) * l0, l0)


def system_of(i, motion=jaxrod.Rotation):
    if i.get("stiffness") == "series":
        return jaxrod.System(mixture_of(i, i["lever"]), motion(), gravity=i["g"])
    return jaxrod.System(rod_of(i), motion(pivot=i["pivot"]) if i.get("pivot") else motion(), gravity=i["g"])


def quietly_system_of(i, motion=jaxrod.Rotation):
    """A wave speed beyond any solid draws a warning at construction, and only that."""
    if math.sqrt(i["E"] / i["rho"]) < 2e4:
        return system_of(i, motion)
    with pytest.warns(UserWarning, match="wave speed"):
        return system_of(i, motion)


# ---- runs


_SAVED = 9  # times in a run: one shape for all, so that each kind of scene is compiled once


@eqx.filter_jit
def _read(sol):
    """Everything that a solution tells, in one compilation."""
    names = ["angle", "rate", "strain", "strain_rate", "director", "energy", "angular_momentum", "tip"]
    read = {name: getattr(sol, name) for name in names}
    if sol.director.shape[-1] == 3:
        read |= {"azimuth": sol.azimuth}
    if sol.center is not None:
        read |= {"center": sol.center}
    state = sol.states
    stretch = 1 + state.strain[:, None]
    read["q"] = stretch * state.direction
    read["qdot"] = state.strain_rate[:, None] * state.direction + stretch * state.direction_rate
    system = sol.system
    terms = [
        jax.vmap(system.kinetic_energy)(state),
        jax.vmap(system.elastic_energy)(state),
        jnp.abs(jax.vmap(system.gravity_energy)(state)),
    ]
    return read | {"energy_scale": jnp.max(sum(terms))}


def run(system, start, times, tolerance=None):
    """What a run tells at `times` (any order); the rest of the _SAVED save times lie before them."""
    later = np.unique(times)
    ts = np.concatenate([np.linspace(0.0, later[0], _SAVED - later.size, endpoint=False), later])
    read = jax.tree.map(np.asarray, _read(jaxrod.simulate(system, start, ts=ts, tolerance=tolerance)))
    energy_scale = read.pop("energy_scale")
    at = {name: value[np.searchsorted(ts, times)] for name, value in read.items()}
    return at | {"energy_scale": energy_scale}


def check(what, got, want, bound, scale):
    error = np.max(np.abs(np.asarray(got) - np.asarray(want))) / scale
    assert error <= bound, f"{what}: error {error:.2e} of its scale {scale:.3g}, allowed {bound:.0e}"


def largest(values, at_least=0.0):
    return max(float(np.max(np.abs(values))), at_least)


def check_planar(got, o, bound, omega_eps):
    check("psi", got["angle"], o["psi"], bound, largest(o["psi"], 1.0))
    check("eps", got["strain"], o["eps"], bound, 1.0)
    check("omega", got["rate"], o["omega"], bound, largest(o["omega"]))
    check("deps", got["strain_rate"], o["deps"], bound, omega_eps)


def check_constants(system, o):
    """omega_eps^2 = C / I and gamma = g S / I: all that a pivoted motion depends on."""
    check("omega_eps", 2 * np.pi * jaxrod.natural_frequencies(system), o["omega_eps"], 1e-13, o["omega_eps"])
    gamma = system.gravity * system.body.first_moments[0] / system.body.mass_matrix[0, 0]
    check("gamma", gamma, o["gamma"], 1e-13, o["gamma"])


def sag_of(system):
    """Strain by which the hanging rod is longer: g S / C."""
    return system.gravity * system.body.first_moments[0] / system.body.stiffness_matrix[0, 0]


def start_of(system, i):
    return system.state(angle=i["psi0"], rate=i["omega0"], strain=i["eps0"], strain_rate=i["deps0"])


# ---- trajectories


@accuracies
@cases("planar_pivot")
def test_planar_pivot(case, tolerance, bound):
    i, o = case["inputs"], case["outputs"]
    system = quietly_system_of(i)
    start = start_of(system, i)
    got = run(system, start, o["t"], tolerance)
    check_planar(got, o, bound, o["omega_eps"])
    # All energy of the lightest rod is in strains of 1e-3, which are held to `bound` of 1 and not of themselves.
    energy_bound = 100 * bound if case["name"] == "tiny_density" else bound
    check("energy", got["energy"], o["energy"], energy_bound, got["energy_scale"])
    if "L" in o:
        check("L", got["angular_momentum"], o["L"], bound, largest(o["L"]))
    check_constants(system, o)


@accuracies
@cases("spherical")
def test_spherical(case, tolerance, bound):
    i, o = case["inputs"], case["outputs"]
    system = system_of(i, jaxrod.Spherical)
    start = system.state(
        angle=i["psi0"], rate=i["dpsi0"], azimuth=i["phi0"], azimuth_rate=i["dphi0"], strain=i["eps0"],
        strain_rate=i["deps0"],
    )  # fmt: skip
    nearest = o["t_min_cos_psi"]
    got = run(system, start, [*o["t"], nearest], tolerance)
    at = {name: value[:-1] for name, value in got.items() if name != "energy_scale"}
    check("q", at["q"], o["q"], bound, 1.0)
    check("tip", at["tip"], i["l0"] * np.asarray(o["q"]), bound, i["l0"])
    check("qdot", at["qdot"], o["qdot"], bound, o["omega_eps"])
    check("psi", at["angle"], o["psi"], bound, largest(o["psi"], 1.0))
    check("eps", at["strain"], o["eps"], bound, 1.0)
    turned = (at["azimuth"] - np.asarray(o["phi_mod_2pi"]) + np.pi) % (2 * np.pi) - np.pi
    check("phi", turned, 0.0, bound, 1.0)
    check("energy", got["energy"], o["energy"], bound, got["energy_scale"])
    momentum = largest(got["angular_momentum"])
    check("Lz", at["angular_momentum"][:, 2], o["Lz"], bound, momentum)
    check_constants(system, o)
    # Where the rod comes nearest to the pole its elevation stands still.
    distance = np.hypot(got["director"][-1, 0], got["director"][-1, 1])
    check("min cos psi", distance, o["min_cos_psi"], bound, 1.0)
    assert distance <= np.min(np.hypot(at["director"][:, 0], at["director"][:, 1])) + bound, "not the nearest approach"


@accuracies
@cases("free_planar")
def test_free_planar(case, tolerance, bound):
    i, o = case["inputs"], case["outputs"]
    system = system_of(i, jaxrod.Flight)
    start = system.state(
        angle=i["psi0"], rate=i["omega0"], strain=i["eps0"], strain_rate=i["deps0"], center=(i["X0"], i["Y0"]),
        center_velocity=(i["VX0"], i["VY0"]),
    )  # fmt: skip
    period = o["radial_period"]
    got = run(system, start, [*o["t"], period], tolerance)
    at = {name: value[:-1] for name, value in got.items() if name != "energy_scale"}
    check_planar(at, o, bound, o["omega_eps_free"])
    check("energy", at["energy"], o["energy"], bound, got["energy_scale"])
    path = np.stack([o["X"], o["Y"]], axis=-1)
    check("center", at["center"], path, bound, largest(path, i["l0"]))
    check("L_C", at["angular_momentum"], o["L_C"], bound, abs(o["L_C"]))
    # After one radial period the strain is what it was, and the rod has turned by a fixed angle.
    advance = o["psi_advance_per_radial_period"]
    check("eps after a radial period", got["strain"][-1], i["eps0"], bound, 1.0)
    check("turn in a radial period", got["angle"][-1] - i["psi0"], advance, bound, largest(advance, 1.0))
    # The strain is largest and least half a period apart; two of the three start from the least.
    longest = period / 2
    if i["deps0"] > 0:
        longest = scipy.optimize.brentq(lambda t: run(system, start, [t])["strain_rate"][0], 1e-3 * period, period / 2)
    extremes = run(system, start, [longest, longest + period / 2], tolerance)
    check("eps_max, eps_min", extremes["strain"], [o["eps_max"], o["eps_min"]], bound, 1.0)
    check(
        "omega_eps_free",
        2 * np.pi * jaxrod.natural_frequencies(system),
        o["omega_eps_free"],
        1e-13,
        o["omega_eps_free"],
    )


def state_of(q, qdot):
    """The state with (1 + eps) d = q: a swinging spring of unit length."""
    q, qdot = np.asarray(q, float), np.asarray(qdot, float)
    stretch = np.sqrt(q @ q)
    stretching = q @ qdot / stretch
    d = q / stretch
    arrays = (d, (qdot - stretching * d) / stretch, np.array([stretch - 1]), np.array([stretching]), np.zeros(()))
    return jaxrod.State(*map(jnp.asarray, arrays))


@accuracies
@cases("swinging_spring")
def test_swinging_spring(case, tolerance, bound):
    i, o = case["inputs"], case["outputs"]
    system = system_of(i, jaxrod.Spherical)
    got = run(system, state_of(i["q0"], i["qdot0"]), o["t"], tolerance)
    check("q", got["q"], o["q"], bound, 1.0)
    check("qdot", got["qdot"], o["qdot"], bound, largest(o["qdot"]))
    check("energy", got["energy"], o["energy"], bound, got["energy_scale"])
    check("Lz", got["angular_momentum"][:, 2], o["Lz"], bound, largest(got["angular_momentum"]))
    sag, body = float(sag_of(system)), system.body
    check("sag", sag, o["sag"], 1e-13, o["sag"])
    strain_rate = 2 * np.pi * float(jaxrod.natural_frequencies(system)[0])
    swing_rate = math.sqrt(i["g"] * body.first_moments[0] / body.mass_matrix[0, 0] / (1 + sag))
    check("omega_eps", strain_rate, o["omega_eps"], 1e-13, o["omega_eps"])
    check("omega_pendulum", swing_rate, o["omega_pendulum"], 1e-13, o["omega_pendulum"])
    check("ratio", strain_rate / swing_rate, o["ratio"], 1e-13, o["ratio"])


@pytest.mark.parametrize("name", ["resonance_lynch_uniform", "resonance_lynch_cone"])
def test_stepwise_precession(name):
    """At resonance the swing comes and goes, each time in another plane.  The file has two digits of it."""
    case = case_named(name)
    i, o = case["inputs"], case["outputs"]
    ts = np.linspace(0, 100, 5001)
    sol = jaxrod.simulate(system_of(i, jaxrod.Spherical), state_of(i["q0"], i["qdot0"]), ts=ts)
    x, y, _ = (1 + np.asarray(sol.strain)) * np.asarray(sol.director).T
    ends = local_maxima(np.hypot(x, y))
    widest = ends[local_maxima(np.hypot(x, y)[ends])]
    cycle = np.mean(np.diff(ts[widest]))
    check("cycle", cycle, o["cycle_time_approx"], 1e-2, o["cycle_time_approx"])
    # A swing goes both ways: its azimuth is known modulo 180 degrees.
    azimuth = np.degrees(np.unwrap(2 * np.arctan2(y, x)[widest])) / 2
    step = np.mean(np.abs(np.diff(azimuth)))
    check("step", step, o["precession_deg_per_cycle_approx"], 1e-2, o["precession_deg_per_cycle_approx"])


def local_maxima(values):
    return np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1


@accuracies
@cases("near_collapse")
def test_near_collapse(case, tolerance, bound):
    """A rod that is pressed together to 1.4 % of its length and bounces back, turning at 7,651 rad/s meanwhile."""
    i, o = case["inputs"], case["outputs"]
    system = system_of(i)
    start = start_of(system, i)
    period = o["radial_period"]
    got = run(system, start, [*o["t"], period / 2, period], tolerance)
    at = {name: value[:-2] for name, value in got.items() if name != "energy_scale"}
    check("q", at["q"], o["q"], bound, largest(o["q"]))
    check("qdot", at["qdot"], o["qdot"], bound, largest(o["qdot"]))
    check("eps_min", got["strain"][-2], o["eps_min"], bound, 1.0)
    check("eps_max", got["strain"][-1], o["eps_max"], bound, 1.0)
    check("omega_max", got["rate"][-2], o["omega_max"], bound, o["omega_max"])
    check("turn in a radial period", got["angle"][-1] - i["psi0"], o["psi_advance"], bound, o["psi_advance"])


# ---- collapse


@cases("collapse")
def test_collapse(case):
    """Straight lines: eps = (eps0 + s) cos(omega t) - s.  The run ends at strain -1 + 1e-6, the file's time is -1's."""
    i, o = case["inputs"], case["outputs"]
    system = system_of(i)
    check("omega_eps", 2 * np.pi * jaxrod.natural_frequencies(system), o["omega_eps"], 1e-13, o["omega_eps"])
    upright = "psi0" in i
    omega, sag = o["omega_eps"], o["sag"] if upright else 0.0
    check("sag", sag_of(system), sag, 1e-13, 1.0)
    amplitude = i["eps0"] + sag
    start = system.state(angle=i.get("psi0", 0.0), strain=i["eps0"])
    half = math.pi / omega
    if not o.get("collapses", True):
        got = run(system, start, [half])
        check("eps_min", got["strain"], o["eps_min"], 1e-8, 1.0)
        return
    sol = jaxrod.simulate(system, start, t1=half, throw=False)
    assert bool(sol.result == jaxrod.Result.collapsed)
    end = -1 + 1e-6
    phase = math.acos((end + sag) / amplitude)
    t_end, speed = phase / omega, amplitude * omega * math.sin(phase)
    check("strain at the end", sol.strain, end, 1e-8, 1.0)
    check("eps_min", sol.strain, o.get("eps_min", -1.0), 1.1e-6, 1.0)
    check("time of the end", sol.stats["t_end"], t_end, 1e-8, t_end)
    check("time saved", sol.ts, t_end, 1e-8, t_end)
    check("speed at the end", -sol.strain_rate, speed, 1e-8, speed)
    check("angle", sol.angle, math.pi / 2 if upright else 0.0, 1e-8, 1.0)
    # The last 1e-6 of strain pass at constant speed; what that leaves out is of second order.
    rest = o["t_collapse"] - float(sol.stats["t_end"])
    check("time from strain -1 + 1e-6 to -1", rest, 1e-6 / speed, 1e-8, o["t_collapse"])
    assert rest > 0.5e-6 / speed, "the run must end before strain -1"
    if "speed_at_collapse" in o:
        # speed^2 = omega^2 (eps0^2 - eps^2), carried on from -1 + 1e-6 to -1
        carried = math.sqrt(float(sol.strain_rate[0]) ** 2 + omega**2 * (end**2 - 1))
        check("speed at strain -1", carried, o["speed_at_collapse"], 1e-8, o["speed_at_collapse"])


# ---- the rod


@cases("geometry")
def test_geometry(case):
    i, o = case["inputs"], case["outputs"]
    rod, pivot = rod_of(i), i["pivot"]
    system = jaxrod.System(rod, jaxrod.Rotation(pivot=pivot), gravity=i["g"])
    body = system.body
    got = {
        "mass": rod.mass,
        "x_C": rod.center_of_mass,
        "X_C": rod.first_moment(about=pivot) / rod.mass,
        "I_C": rod.moment_of_inertia(about=rod.center_of_mass),
        "I_A": rod.moment_of_inertia(about=pivot),
        "c_energy": rod.stiffness / rod.length**2,
        "omega_eps_energy": 2 * np.pi * jaxrod.natural_frequencies(system)[0],
        "omega_eps_free": 2 * np.pi * jaxrod.natural_frequencies(jaxrod.System(rod, jaxrod.Flight()))[0],
        "static_sag": sag_of(system),
    }
    mixture = mixture_of(i)
    if pivot == 0:  # (16) is measured from the end of radius r
        got |= {"I_A by (16)": mixture.inertia, "x_C by hand": mixture.first_moment / rod.mass}
    mixture = dataclasses.replace(mixture, inertia=rod.moment_of_inertia(about=pivot))
    got["c_series"] = mixture.stiffness / mixture.length**2
    got["omega_eps_paper"] = 2 * np.pi * jaxrod.natural_frequencies(jaxrod.System(mixture, jaxrod.Rotation()))[0]
    for name, value in got.items():
        want = o[name.split(" ")[0]]
        check(name, value, want, 1e-13, abs(want))
    check("I_A of the projection", body.mass_matrix, np.full((2, 2), o["I_A"]), 1e-13, o["I_A"])
    check("first moments", body.first_moments, np.full(2, o["mass"] * o["X_C"]), 1e-13, o["mass"] * o["X_C"])


# ---- the paper's slips


@cases("paper_error")
def test_paper_errors(case):
    i, o = case["inputs"], case["outputs"]
    rod = rod_of(i)
    s, _ = rod.quadrature()
    compliance = rod.integrate(1 / rod.area(s) ** 2)  # int dx / A
    omega, too_high = _frequencies(material_of(i))
    _, too_high_if_uniform = _frequencies(material_of(i | {"r_pivot": 0.025, "r_tip": 0.025}))
    with pytest.warns(UserWarning, match="10\\^7 MPa"):
        stiff = jaxrod.System(rod_of(i | {"E": 1e13}), jaxrod.Rotation())  # 10^7 MPa, as Figure 2 prints it
    got = {
        "c_eq12_as_printed": rod.young * compliance,  # inverted, and of dimension Pa/m
        "c_eq14": rod.young / compliance,
        "c_energy": rod.stiffness / rod.length**2,
        "ratio_energy_series": rod.stiffness / rod.length**2 / (rod.young / compliance),
        "x_C": rod.center_of_mass,
        "lever_in_15": rod.length / 2,
        "lever_error": rod.length / 2 / rod.center_of_mass - 1,
        "omega_eps_if_E_1e7MPa": 2 * np.pi * jaxrod.natural_frequencies(stiff)[0],
        "frequency_ratio_uniform": 1 + too_high_if_uniform / 100,
        "frequency_error_fig2_cone_paper": omega["paper"] / omega["fixed_free"][0] - 1,
        "frequency_error_fig2_cone_energy": too_high / 100,
    }
    assert set(got) == set(o)
    for name, value in got.items():
        check(name, value, o[name], 1e-12, abs(o[name]))


@cases("paper_error_9b")
def test_equation_9_as_printed_loses_angular_momentum(case):
    """Its second equation lacks a square: 2 (1+eps) for 2 (1+eps)^2.  Neither L_z nor the energy stays what it was."""
    i, o = case["inputs"], case["outputs"]
    system = system_of(i, jaxrod.Spherical)
    body = system.body
    inertia, moment = float(body.mass_matrix[0, 0]), float(body.first_moments[0])
    k, gamma = float(body.stiffness_matrix[0, 0]) / inertia, i["g"] * moment / inertia

    def printed(t, y):
        psi, _, eps, dpsi, dphi, deps = y
        r, sin, cos = 1 + eps, math.sin(psi), math.cos(psi)
        ddpsi = (-2 * r * dpsi * deps - r**2 * cos * sin * dphi**2 - r * gamma * cos) / r**2
        ddphi = (-2 * r * cos**2 * dphi * deps + 2 * r * cos * sin * dphi * dpsi) / (r * cos) ** 2
        ddeps = r * dpsi**2 + r * cos**2 * dphi**2 - k * eps - gamma * sin
        return [dpsi, dphi, deps, ddpsi, ddphi, ddeps]

    names = ("psi0", "phi0", "eps0", "dpsi0", "dphi0", "deps0")
    y0 = [i[name] for name in names]
    y = scipy.integrate.solve_ivp(printed, (0, 1), y0, "DOP853", t_eval=o["t"], rtol=1e-13, atol=1e-13).y

    def constants(y):
        psi, _, eps, dpsi, dphi, deps = y
        r, cos = 1 + eps, jnp.cos(psi)
        kinetic = (deps**2 + (r * dpsi) ** 2 + (r * cos * dphi) ** 2) / 2
        return inertia * (r * cos) ** 2 * dphi, inertia * (kinetic + k * eps**2 / 2 + gamma * r * jnp.sin(psi))

    Lz, E = constants(y)
    check("Lz of the printed equation", Lz, o["Lz_printed"], 1e-10, o["Lz0"])
    check("energy of the printed equation", E, o["E_printed"], 1e-10, o["E0"])
    at_start, slopes = jax.jvp(constants, (jnp.array(y0),), (jnp.array(printed(0.0, y0)),))
    for name, got in zip(("Lz0", "E0", "dLz_dt_at_0_printed", "dE_dt_at_0_printed"), (*at_start, *slopes), strict=True):
        check(name, got, o[name], 1e-12, abs(o[name]))

    start = system.state(
        angle=i["psi0"], rate=i["dpsi0"], azimuth=i["phi0"], azimuth_rate=i["dphi0"], strain=i["eps0"],
        strain_rate=i["deps0"],
    )  # fmt: skip
    got = run(system, start, o["t"])
    check("Lz of jaxrod", got["angular_momentum"][:, 2], o["Lz0"], 1e-10, o["Lz0"])
    check("energy of jaxrod", got["energy"], o["E0"], 1e-10, got["energy_scale"])
    assert np.all(np.abs(np.asarray(o["Lz_printed"]) / o["Lz0"] - 1) > 1e-4), "the slip must be far above the tolerance"


# ---- frequencies of the exact rod


@jax.jit
def _frequencies(p):
    """Everything in rad/s (the error in percent), in one compilation."""
    rod = rod_of(p)
    pinned, free = jaxrod.System(rod, jaxrod.Rotation()), jaxrod.System(rod, jaxrod.Flight())
    mixture = jaxrod.System(mixture_of(p), jaxrod.Rotation())
    omega = {
        "uniform strain": jaxrod.natural_frequencies(pinned)[0],
        "paper": jaxrod.natural_frequencies(mixture)[0],
        "fixed_free": jaxrod.continuum.natural_frequencies(pinned, 5),
        "free_free": jaxrod.continuum.natural_frequencies(free, 5),
    }
    return {name: 2 * np.pi * value for name, value in omega.items()}, jaxrod.frequency_error(pinned)[0]


def material_of(i):
    return {name: float(i.get(name, 1.0)) for name in MATERIAL}


@cases("pde_frequencies")
def test_exact_frequencies(case):
    p, o = material_of(case["inputs"]), case["outputs"]
    omega, too_high = _frequencies(p)
    unit = math.sqrt(p["E"] / p["rho"]) / p["l0"]  # rad/s for kappa = 1
    for ends in ("fixed_free", "free_free"):
        np.testing.assert_allclose(omega[ends] / unit, o[f"kappa_{ends}"], rtol=1e-13, err_msg=ends)
        if f"omega_{ends}" in o:
            np.testing.assert_allclose(omega[ends], o[f"omega_{ends}"], rtol=1e-13, err_msg=ends)
    uniform_strain, mixed = o["kappa_uniform_strain_energy"], o["kappa_paper_mixed"]
    check("uniform strain", omega["uniform strain"] / unit, uniform_strain, 1e-13, uniform_strain)
    check("paper's mixture", omega["paper"] / unit, mixed, 1e-13, mixed)
    check("frequency_error", too_high / 100, uniform_strain / o["kappa_fixed_free"][0] - 1, 1e-12, 1.0)


# ---- sensitivities


@functools.cache
def _derivatives(stiffness):
    """(psi, eps, omega, deps) at a time T and their derivatives by all that enters: one compilation for each model.

    Forward mode, which compiles faster; that reverse mode agrees with it is shown in test_gradients.py.
    """

    def end(p, T):
        system = system_of(p | {"stiffness": stiffness, "lever": "l0/2"})
        start = system.state(angle=p["psi0"], rate=p["omega0"], strain=p["eps0"], strain_rate=p["deps0"])
        sol = jaxrod.simulate(system, start, t1=T, adjoint=diffrax.ForwardMode())
        last = {"psi": sol.angle, "eps": sol.strain, "omega": sol.rate, "deps": sol.strain_rate}
        last = {name: value[-1] for name, value in last.items()}
        return last, last

    return jax.jit(jax.jacfwd(end, has_aux=True))


@cases("sensitivities")
def test_sensitivities(case):
    i, o = case["inputs"], case["outputs"]
    parameters = {name: jnp.asarray(float(i[name])) for name in (*MATERIAL, "g", *STARTS)}
    by, end = _derivatives(i["stiffness"])(parameters, jnp.asarray(i["T"]))
    check("psi", end["psi"], o["psi"], 1e-8, largest(o["psi"], 1.0))
    check("eps", end["eps"], o["eps"], 1e-8, 1.0)
    check("omega", end["omega"], o["omega"], 1e-8, abs(o["omega"]))
    check("deps", end["deps"], o["deps"], 1e-8, 2 * np.pi * float(jaxrod.natural_frequencies(system_of(i))[0]))
    tested = set(end)
    for output, row in by.items():
        for name, value in row.items():
            want = o[f"d_{output}_d_{name}"]
            check(f"d {output} / d {name}", value, want, 1e-6, abs(want))
            tested.add(f"d_{output}_d_{name}")
    assert tested == set(o)


@functools.cache
def _frequency_derivatives(jacobian):
    def named(p):
        omega, _ = _frequencies(p)
        named = {"omega_eps_energy": omega["uniform strain"], "omega_eps_paper": omega["paper"]}
        named |= {f"omega_pde_{n + 1}": omega["fixed_free"][n] for n in range(2)}
        return named, named

    return jax.jit(jacobian(named, has_aux=True))


@pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
@cases("frequency_sensitivities")
def test_frequency_sensitivities(case, jacobian):
    o = case["outputs"]
    by, omega = _frequency_derivatives(jacobian)(material_of(case["inputs"]))
    tested = set(by)
    for output, row in by.items():
        check(output, omega[output], o[output], 1e-13, o[output])
        for name, value in row.items():
            want = o[f"d_{output}_d_{name}"]
            check(f"d {output} / d {name}", value, want, 1e-12, abs(want))
            tested.add(f"d_{output}_d_{name}")
    assert tested == set(o)

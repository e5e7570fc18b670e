# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A rod you measured
#
# From radii on a sheet of paper to a rod that hangs, swings and rings; then from one measured frequency to its modulus.
# The rod is invented: soft rubber, somewhat irregular, with a bulge. Put your own numbers into `measured_radii.csv`.

# %%
# %matplotlib inline
import dataclasses
import pathlib

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxrod

said = jaxrod.configure()

# %% [markdown]
# ## The rod
#
# A `Table` runs a smooth curve through what was measured and adds no waves of its own.

# %%
name = pathlib.Path("measured_radii.csv")  # station, radius in mm
table = np.loadtxt(name if name.exists() else "notebooks" / name, delimiter=",", skiprows=1)
station, radius = 1e-3 * table.T
rod = jaxrod.Rod(length=station[-1], section=jaxrod.Table(station, radius), young=2e6, density=1150.0)
print(f"{station.size} stations, {1e3 * radius.min():.2f} to {1e3 * radius.max():.2f} mm")
print(f"mass {1e3 * rod.mass:.1f} g, centre of mass {1e3 * rod.center_of_mass:.1f} mm from the root")

# %% [markdown]
# ## How many shapes?
#
# Axial frequencies in Hz, hung on its root, for 1 to 4 strain shapes in both bases. They come down to the exact ones.

# %%
hung = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(3), gravity=9.81)
exact = jaxrod.continuum.natural_frequencies(hung, 4)
for basis in (jaxrod.Ritz, jaxrod.ForceRitz):
    for n in (1, 2, 3, 4):
        found = jaxrod.natural_frequencies(dataclasses.replace(hung, basis=basis(n)))
        off = 100 * (found[0] / exact[0] - 1)
        print(f"{basis.__name__ + f'({n})':<12}" + "".join(f"{f:9.3f}" for f in found).ljust(40) + f"f1 {off:+.3f} %")
print("exact".ljust(12) + "".join(f"{f:9.3f}" for f in exact))

# %% [markdown]
# ## What the model leaves out

# %%
print(jaxrod.model_limits(hung))

# %% [markdown]
# The rod is straight in the model. This one, in your hand, bends far more easily than it stretches; hanging, or spun
# fast enough, it stays straight.
#
# ## Along the rod
#
# Hanging, the strain follows from the weight below, and is larger where the rod is thin. `Ritz(3)` draws the big line of
# it, `ForceRitz(3)` the details too: the force is smooth, and the strain is force over rigidity.
#
# Last, the change of the first exact frequency with each measured radius, a gradient through the table. Thicker at the
# root is stiffer, thicker at the tip heavier: measure the outer parts with care, the middle hardly matters. (The first
# and the last radius speak for half as much rod as the others.)


# %%
def first(radii):
    scene = jaxrod.System(dataclasses.replace(rod, section=jaxrod.Table(station, radii)), jaxrod.Rotation())
    return jaxrod.continuum.natural_frequencies(scene, 1)[0]


slope = 1e-3 * jax.grad(first)(jnp.asarray(radius))  # Hz per mm

s = np.linspace(0.0, station[-1], 601)
figure, (shape, strain, change) = plt.subplots(3, 1, figsize=(8, 7), sharex=True, layout="constrained")
r = 1e3 * np.sqrt(rod.area(jnp.asarray(s)) / np.pi)
shape.fill_between(1e3 * s, -r, r, color="#1f5fa8", alpha=0.25)
shape.plot(1e3 * station, 1e3 * radius, ".", color="#1f5fa8")
shape.set_ylabel("radius, mm")
for basis, color in ((jaxrod.Ritz(3), "#1f5fa8"), (jaxrod.ForceRitz(3), "#d9661f")):
    scene = dataclasses.replace(hung, basis=basis)
    sag = jaxrod.equilibrium(scene)
    field = 100 * scene.strain_field(sag, jnp.asarray(s))
    strain.plot(1e3 * s, field, color=color, label=f"{type(basis).__name__}(3)")
    print(f"{type(basis).__name__}(3): hanging, the tip is {1e3 * sag.strain * rod.length:.4f} mm lower")
strain.set_ylabel("strain hanging, %")
strain.legend()
change.bar(1e3 * station, slope, width=30, color=np.where(slope > 0, "#1f5fa8", "#d9661f"))
change.axhline(0, color="black", linewidth=0.8)
change.set_ylabel("change of f1, Hz for each mm")
change.set_xlabel("from the root, mm")
for axis in (shape, strain, change):
    axis.grid(alpha=0.25)

# %% [markdown]
# All radii larger by the same part change nothing: length and material alone would tell. And what a caliper costs:

# %%
print(f"all radii 1 % larger: f1 changes by less than {max(1e-12, abs(0.01 * 1e3 * (slope @ radius))):.0e} Hz")
print(f"each radius uncertain by 0.05 mm: f1 by {0.05 * np.linalg.norm(slope):.3f} Hz of {exact[0]:.2f} Hz")

# %% [markdown]
# ## A swing
#
# Let go from the horizontal, unstretched. The elongation follows weight and turning; the small ripple on it is the rod
# ringing, which nothing damps here.

# %%
ts = jnp.linspace(0.0, 3.0, 1501)
swing = jaxrod.simulate(hung, hung.state(angle=0.0), ts=ts)
print(swing)

figure, (angle, tip) = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
angle.plot(ts, np.degrees(swing.angle), color="#1f5fa8")
angle.set_ylabel("angle, degrees")
angle.set_yticks([-180, -90, 0])
tip.plot(ts, 1e3 * swing.strain * rod.length, color="#d9661f", linewidth=0.9)
tip.set_ylabel("elongation, mm")
tip.set_xlabel("time, s")
for axis in (angle, tip):
    axis.grid(alpha=0.25)

# %% [markdown]
# ## The modulus from one frequency
#
# Say the rod rings at 12.0, 12.2 and 12.15 Hz in three trials, each give or take 0.1. Its shape is known, so the one
# frequency tells the modulus (over the density).


# %%
def ring(p):
    scene = jaxrod.System(dataclasses.replace(rod, young=p["young"]), jaxrod.Rotation())
    return jnp.tile(jaxrod.continuum.natural_frequencies(scene, 1), 3)


print(jaxrod.fit(ring, data=[12.0, 12.2, 12.15], sigma=0.1, start={"young": jaxrod.Positive(2e6)}))

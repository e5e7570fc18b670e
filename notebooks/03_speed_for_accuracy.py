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
# # Speed for accuracy
#
# How wrong is this number, and what would it cost to halve the error? A rubber cone, set spinning, and four questions to it.

# %%
# %matplotlib inline
import jax.numpy as jnp
import matplotlib.pyplot as plt
from IPython.display import display

import jaxrod

said = jaxrod.configure()
sudden = jaxrod.scenes.cone_started_suddenly()
steady = jaxrod.scenes.cone_started_steadily()
system, start = sudden.system, sudden.start  # uniform strain, 15 rad/s under gravity

# %% [markdown]
# ## The model, or the start?
#
# The same rod, the same spin, two starts: unstretched when it is set spinning, or already stretched by its spin. The exact
# rod in motion (`continuum.simulate`, its own equations, no strain shapes) against uniform strain.

# %%
ts = jnp.linspace(0.0, 2.0, 401)[1:]
fig, axes = plt.subplots(1, 2, figsize=(9, 3), sharey=True, layout="constrained")
for axis, static, title in zip(axes, (False, True), ("started suddenly", "started steadily"), strict=True):
    exact = jaxrod.continuum.simulate(system, start, ts=ts, static=static, error=False)
    begin = jaxrod.ladder.at_rest(system, start) if static else start
    model = jaxrod.simulate(system, begin, ts=ts)
    axis.plot(ts, 100 * exact.tip_stretch, label="exact rod")
    axis.plot(ts, 100 * model.strain, "--", label="uniform strain")
    axis.set(
        title=f"{title}: angle off by {abs(model.angle[-1] - exact.angle[-1]):.2g} rad after 2 s", xlabel="time, s"
    )
axes[0].set_ylabel("elongation of the tip, %")
axes[0].legend()
plt.show()

# %% [markdown]
# A sudden start rings every overtone of the rod, of which uniform strain has none; within a few periods its phase is lost,
# and the angle with it. Started steadily nothing rings. The model is the same; the start decides what it is worth.
#
# ## How wrong is this number?
#
# `budget=` measures it: by richer rungs, by finer steps, by a nudge to the start.

# %%
for basis in (jaxrod.Ritz(1), jaxrod.LoadRitz(3)):
    scene, begin = jaxrod.ladder.on_rung(system, start, basis)
    print(basis, jaxrod.simulate(scene, begin, t1=2.0, budget=jaxrod.FinalAngle()).budget, sep="\n", end="\n\n")

# %% [markdown]
# ## What would halving it cost?
#
# `tradeoff` runs the scene in many ways, here and now: rungs, solvers, steps, float types. Large points are those that no
# other beats in both; the dotted line is what the reference itself is good for.

# %% tags=["measured"]
found = jaxrod.tradeoff(system, start, t1=2.0, quantity=sudden.quantity, seconds=60, progress=False)
print(found)
display(jaxrod.plot.tradeoff(found, sudden.title))

# %% [markdown]
# From uniform strain no step size buys a digit: its error is the model's. Two more shapes buy four digits for less
# than twice the time.
#
# ## What should I take?
#
# `plan` finds the cheapest way to a tolerance, and `simulate(plan=plan)` follows it, in a sweep too.

# %%
plans = {
    tolerance: jaxrod.plan(system, start, t1=2.0, tolerance=tolerance, quantity=sudden.quantity)
    for tolerance in (1e-2, 1e-4, 1e-6)
}
for plan in plans.values():
    print(plan, end="\n\n")
rates = jnp.linspace(14.0, 16.0, 200)
angles = jaxrod.sweep(
    lambda rate: jaxrod.simulate(system, system.state(rate=rate), t1=2.0, plan=plans[1e-2]).angle[-1], rates
)
print(f"200 scenes as planned: {angles.min():.2f} to {angles.max():.2f} rad")

# %% [markdown]
# ## A blow
#
# The same lesson at its hardest: struck at the tip, by a force that is over before its wave is at the root. A fixed end
# doubles a wave; uniform strain spreads the blow over the whole rod.

# %%
blow = jaxrod.scenes.impact()
ts = jnp.linspace(0.0, blow.t1, 401)[1:]
exact = jaxrod.continuum.simulate(blow.system, blow.start, ts=ts, error=False)
fig, axis = plt.subplots(figsize=(7, 3), layout="constrained")
axis.plot(1e3 * ts, 100 * exact.strain_field([0.0])[:, 0], "k", label="exact rod")
for basis in (jaxrod.Ritz(1), jaxrod.LoadRitz(6)):
    model = jaxrod.simulate(*jaxrod.ladder.on_rung(blow.system, blow.start, basis), ts=ts)
    axis.plot(1e3 * ts, 100 * model.strain_field(jnp.zeros(1))[:, 0], "--", label=f"{type(basis).__name__}({basis.n})")
axis.set(title="a blow at the tip of 1 %", xlabel="time, ms", ylabel="strain of the root, %")
axis.legend()
plt.show()

# %% [markdown]
# ## When not to ask
#
# Stretch a uniform rod evenly and let it go: its tip follows a triangle wave, and a kink runs up and down it. No few smooth
# shapes hold a kink, nor 256 modes, and `plan` says so instead of promising.

# %%
uniform = jaxrod.System(
    jaxrod.Rod(1.0, jaxrod.Uniform(0.025), young=1e7, density=1200.0), jaxrod.Rotation(), jaxrod.Ritz(1)
)
print(jaxrod.plan(uniform, uniform.state(strain=0.02), t1=0.03, tolerance=1e-7))

# %% [markdown]
# And where two starts part for good, no digits help. A rod so soft that its swing and its strain are in resonance, where runs
# with more and more modes lead elsewhere each time (which is what `plan` says):

# %%
soft = jaxrod.Rod(1.0, jaxrod.Uniform(0.025), young=17658.0, density=1200.0)
spring = jaxrod.System(soft, jaxrod.Rotation(), gravity=9.81)
wild = spring.state(angle=-1.5708, strain=0.3333, rate=2.7, strain_rate=-4.8)
print(jaxrod.horizon(spring, wild, t1=60.0, tolerance=1e-6))
print(jaxrod.plan(spring, wild, t1=60.0, tolerance=1e-6))

# %% [markdown]
# ## The limit of stiff rods
#
# As E grows, the rigid rod, the strain that follows its loads, and uniform strain approach one another by powers of
# delta = (turning rate / axial rate)^2, as closed forms say; `plan` uses them to leave out what has no chance.
#
# ![Errors against delta](../docs/limits.png)

"""What every other package stands on; it knows no mechanics.

- Numbers that users give: `validation` (one sentence of refusal each), `units`, `calling` (functions of theirs).
- Numbers that JAX traces: `tracing` (what is known of them; functions as programs), `precision` (their float type).
- Mathematics: `linear_algebra` with derivatives of any order, one matrix after another.
- Programs: `lanes` has many scenes side by side in the last axis of every array, for loops over time; `each_lane`, what is
  written for one of them.
- `result`: how a run ended.  `progress`: what takes long says so.

Composes with everything; imports `configuration` alone.
"""

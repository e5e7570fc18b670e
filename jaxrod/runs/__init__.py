"""One run: what is asked, how it is stepped, what it returns.

`arguments` checks what is asked; `defaults` chooses solver and chart.  `fixed_steps` counts equal steps and runs them,
`adaptive_steps` has Diffrax adapt them.  `solution` is what they return, `invariants` the books of what was kept.
"""

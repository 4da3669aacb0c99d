"""The loop on a rig: what is measured is not the state, the plant is not the model, things fail.

Faults, supervision, the closed loop over sensors and estimator, its record. May import
`estimation`, `control` and what is below them.
"""

"""The arm as its sensors show it: sensors, estimator, observability, consistency.

May import `model`, `statics`, `simulation` and `control`.
"""

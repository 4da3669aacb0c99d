"""The arm under control: paths, optimal control, MPC, closed loop.

May import `model`, `statics` and `simulation`.
"""

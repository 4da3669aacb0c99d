"""What the arm is: parameters, geometry, mechanics, hydraulics, scenes and `build`.

Imports nothing of the other rooms; only `softmpc.errors`.
"""

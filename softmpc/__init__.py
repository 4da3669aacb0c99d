"""softmpc: optimal control and MPC of fluid-driven soft manipulators on CasADi.

`Scene` says what exists, `build` makes the CasADi model of it. Everything else takes a model.
"""

"""What accuracy costs in time: configurations of a scene measured, and the cheapest one chosen.

Lives here: the study, its families of measurements and their references, orders of convergence,
Pareto fronts, the choice within a tolerance. May import `study` and what is below it.
"""

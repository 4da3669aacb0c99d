"""Studies of a scene by running it: what each part of it changes, costs and leaves out.

Lives here: ablation of effects and slots, the cheapest scene within a tolerance, accuracy notes.
May import `simulation` and what is below it.
"""

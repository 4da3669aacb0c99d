"""The arm at rest: postures under pressures and loads, and what they reach. May import `model`."""

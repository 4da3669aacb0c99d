"""The arm at rest: postures under pressures and loads, reach. May import `model`."""

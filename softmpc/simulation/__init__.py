"""The arm in motion: inputs over time, integrators, results. May import `model`, `statics`."""

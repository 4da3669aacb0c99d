"""The arm at rest: postures under pressures and loads, inverse statics, workspace. May import `model`."""

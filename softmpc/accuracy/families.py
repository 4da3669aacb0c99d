"""The families of measurements by name."""

from __future__ import annotations

from softmpc.accuracy.family import Family
from softmpc.accuracy.loop import Loop
from softmpc.accuracy.motion import Motion
from softmpc.accuracy.rest import Rest

__all__ = ["FAMILIES"]

FAMILIES: dict[str, Family] = {family.name: family for family in (Rest(), Motion(), Loop())}

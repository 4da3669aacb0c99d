"""Lengths as people write them: 1mm, 0.5 mm, 50um, 0.002 m."""

from __future__ import annotations

import re

from softmpc.errors import InputError

__all__ = ["length_m", "length_text"]

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}  # both signs of µ
SHORTEST, LONGEST = 1e-9, 10.0  # m; below, rounding is all there is
FORM = re.compile(r"\s*([0-9.eE+-]+)\s*([a-zµμ]+)\s*")


def length_m(text: str) -> float:
    """The length in m; raises `InputError` for what is no number with a unit, or out of range."""
    allowed = "a number with its unit, like 1mm, 50um, 0.2cm or 0.002m"
    match = FORM.fullmatch(text)
    if not match or match[2] not in METRES:
        raise InputError(f"length {text!r}: must be {allowed}")
    try:
        value = float(match[1]) * METRES[match[2]]
    except ValueError:
        raise InputError(f"length {text!r}: {match[1]!r} is no number; must be {allowed}") from None
    if not SHORTEST <= value <= LONGEST:
        raise InputError(f"length {text!r} = {value:g} m: must be between 1e-9 and 10 m")
    return value


def length_text(metres: float) -> str:
    """A length for people: three digits in µm, mm or m; what rounds to no nanometre is 0."""
    if metres < SHORTEST / 2:
        return "0"
    for unit, size in (("µm", 1e-6), ("mm", 1e-3)):
        if metres < 999.5 * size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres:.3g} m"

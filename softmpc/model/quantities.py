"""Dataclass fields that know their unit, source, validity range and meaning."""

import dataclasses
import math
from collections.abc import Iterable
from numbers import Real
from typing import Any

from softmpc.errors import InputError, ParameterError, unknown_name

__all__ = [
    "SOURCES",
    "Range",
    "check_quantities",
    "choice",
    "is_number",
    "parts",
    "quantity",
    "toml_key",
    "vector",
]

SOURCES = ("table 1", "deduced", "fitted", "assumed")


@dataclasses.dataclass(frozen=True)
class Range:
    """The finite numbers from ``low`` to ``high``; ``low_open`` leaves ``low`` itself out.

    With ``or_inf`` infinity is one more.
    """

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    or_inf: bool = False

    def __contains__(self, value: float) -> bool:
        if self.or_inf and value == math.inf:
            return True
        above = value > self.low if self.low_open else value >= self.low
        return above and value <= self.high and math.isfinite(value)

    def __str__(self) -> str:
        """Say in words what is allowed, for messages and for the reference page."""
        return f"{self._finite}, or inf" if self.or_inf else self._finite

    @property
    def _finite(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        bounded = math.isfinite(self.low), math.isfinite(self.high)
        if bounded == (False, False):
            return f"a finite number in {self.unit}" if unit else "a finite number"
        low = f"{'above' if self.low_open else 'at least'} {self.low:.12g}"
        high = f"at most {self.high:.12g}"
        if bounded == (True, True):
            between = f"between {self.low:.12g} and {self.high:.12g}"
            return f"{low} and {high}{unit}" if self.low_open else between + unit
        return f"{low if bounded[0] else high}{unit}"

    @property
    def a_number(self) -> str:
        """``a number in m``: what is wanted when no number was given."""
        return f"a number in {self.unit}" if self.unit else "a number"

    def check(self, label: str, value: Any, error: type[InputError] = ParameterError) -> float:
        """Return ``value`` as a float, or raise ``error`` naming what is allowed."""
        if not is_number(value):
            raise error(f"{label} = {value!r}: must be {self.a_number}")
        number = _as_float(value)
        if number not in self:
            unit = f" {self.unit}" if self.unit else ""
            raise error(f"{label} = {number:.12g}{unit}: must be {self}")
        return number


def is_number(value: Any) -> bool:
    """Return whether ``value`` is a real number; ``True`` and ``False`` are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer with more than 308 digits
        return math.inf if value > 0 else -math.inf


def quantity(
    default: Any,
    *,
    unit: str,
    source: str,
    low: float,
    high: float,
    doc: str,
    toml: str | None = None,
    low_open: bool = False,
    or_inf: bool = False,
    count: int | None = None,
) -> Any:
    """Return a dataclass field for a number (or, if ``default`` is a tuple, for several).

    ``source`` is one of `SOURCES`, a colon and a short explanation; ``toml`` is the key in scene
    files where it differs from the field's name; ``count`` is how many numbers there must be.
    """
    if source.partition(":")[0] not in SOURCES:
        raise ParameterError(unknown_name("source", source, SOURCES))
    metadata = {
        "range": Range(unit, low, high, low_open, or_inf),
        "many": isinstance(default, tuple),
        "count": count,
        "source": source,
        "doc": doc,
        "toml": toml,
    }
    return dataclasses.field(default=default, metadata=metadata)


def vector(default: tuple[float, float, float], *, unit: str, source: str, doc: str) -> Any:
    """Return a dataclass field for three finite numbers."""
    return quantity(
        default, unit=unit, source=source, doc=doc, low=-math.inf, high=math.inf, count=3
    )


def parts(allowed: dict[str, type], *, doc: str) -> Any:
    """Return a dataclass field for a tuple of objects, each of one of the ``allowed`` classes.

    The classes are dataclasses of quantities; in scene files each object is a table with its
    class's name as ``kind``.
    """
    return dataclasses.field(default=(), metadata={"parts": allowed, "source": "", "doc": doc})


def choice(default: str, *, allowed: tuple[str, ...], source: str, doc: str) -> Any:
    """Return a dataclass field for one of the ``allowed`` words."""
    return dataclasses.field(
        default=default, metadata={"allowed": allowed, "source": source, "doc": doc}
    )


def toml_key(item: "dataclasses.Field[Any]") -> str:
    """Return the name of a field in scene files."""
    return item.metadata.get("toml") or item.name


def check_quantities(obj: Any) -> None:
    """Check every quantity and choice of a dataclass instance, and store numbers as floats."""
    for item in dataclasses.fields(obj):
        label, value = f"{type(obj).__name__}.{item.name}", getattr(obj, item.name)
        if "range" in item.metadata:
            check = _check_many if item.metadata["many"] else Range.check
            checked = check(item.metadata["range"], label, value)
            _check_count(label, checked, item.metadata["count"])
            object.__setattr__(obj, item.name, checked)
        elif "allowed" in item.metadata and value not in item.metadata["allowed"]:
            raise ParameterError(unknown_name(label, value, item.metadata["allowed"]))
        elif "parts" in item.metadata:
            object.__setattr__(
                obj, item.name, _check_parts(label, value, tuple(item.metadata["parts"].values()))
            )


def _check_count(label: str, numbers: Any, count: int | None) -> None:
    if count is not None and len(numbers) != count:
        raise ParameterError(f"{label} = {numbers!r}: must be {count} numbers")


def _check_parts(label: str, value: Any, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    names = " or ".join(kind.__name__ for kind in kinds)
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ParameterError(f"{label} = {value!r}: must be a list of {names} objects")
    found = tuple(value)
    for i, item in enumerate(found):
        if not isinstance(item, kinds):
            raise ParameterError(f"{label}[{i}] = {item!r}: must be a {names} object")
    return found


def _check_many(allowed: Range, label: str, value: Any) -> tuple[float, ...]:
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ParameterError(f"{label} = {value!r}: must be a list, each {allowed.a_number}")
    numbers = tuple(allowed.check(f"{label}[{i}]", item) for i, item in enumerate(value))
    if not numbers:
        raise ParameterError(f"{label} = (): must have at least one number")
    return numbers

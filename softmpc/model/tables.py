"""A strict reader for one table of a scene file: typed, ranged, and no key left unread."""

from collections.abc import Iterable, Sequence
from typing import Any

from softmpc.errors import SceneError, nearest, unknown_name
from softmpc.model.quantities import Range, is_number

__all__ = ["REQUIRED", "Table"]

REQUIRED: Any = object()
MISSPELT = 0.7  # how alike a key must be to one that is missing, to be suggested


class Table:
    """Read each key once with its type, then call `finish`.

    Every method takes the key and its default (without one the key must be there). ``where`` names
    the table in messages, for instance ``[track]``. Asking ``key in table`` makes the key known.
    ``doc`` says in a few words what a key means, for who left it out.
    """

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise SceneError(f"{where} = {data!r}: must be a table of keys and values")
        self.where = where
        self.known: dict[str, None] = {}  # in the order of asking
        self._data = data

    def __contains__(self, key: str) -> bool:
        self.known[key] = None
        return key in self._data

    def raw(self, key: str, default: Any = REQUIRED, wanted: str = "") -> Any:
        """Return the value of ``key`` unchecked; ``wanted`` says what is missing."""
        if key in self:
            return self._data[key]
        if default is REQUIRED:
            unread = [name for name in self._data if name not in self.known]
            near = nearest(key, unread, MISSPELT)
            hint = f": {wanted}" if wanted else ""
            hint = f"; is it {near!r}, misspelt?" if near else hint
            raise SceneError(f"{self.where} {key}: is missing{hint}")
        return default

    def table(self, key: str) -> "Table":
        """Return the table below ``key``, empty when absent."""
        return Table(self.raw(key, {}), f"[{key}]")

    def number(
        self, key: str, default: float = REQUIRED, *, doc: str = "", **allowed: Any
    ) -> float:
        """Return a number; ``allowed`` are the fields of `Range`: unit, low, high, low_open."""
        span = Range(**allowed)
        return self._each(key, [self.raw(key, default, _said(doc, span.a_number))], span)[0]

    def integer(self, key: str, default: int = REQUIRED, *, low: int = 0, high: int = 10**9) -> int:
        """Return a whole number from ``low`` to ``high``."""
        value = self.raw(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.error(key, value, f"a whole number from {low} to {high}")
        return value

    def boolean(self, key: str, default: bool = REQUIRED) -> bool:
        """Return true or false."""
        value = self.raw(key, default)
        if not isinstance(value, bool):
            raise self.error(key, value, "true or false")
        return value

    def string(
        self, key: str, default: str = REQUIRED, allowed: Iterable[str] = (), *, doc: str = ""
    ) -> str:
        """Return a text, one of ``allowed`` if there are any."""
        names = list(allowed)
        wanted = f"a text, one of {', '.join(names)}" if names else "a text in quotes"
        value = self.raw(key, default, _said(doc, wanted))
        if not isinstance(value, str):
            raise self.error(key, value, wanted)
        if names and value not in names:
            raise SceneError(f"{self.where} {unknown_name(key, value, names)}")
        return value

    def strings(
        self, key: str, default: Iterable[str] = REQUIRED, *, allowed: Iterable[str]
    ) -> tuple[str, ...]:
        """Return a list of texts, each one of ``allowed``."""
        value, names = self.raw(key, default), list(allowed)
        if not isinstance(value, list | tuple):
            raise self.error(key, value, f"a list of {', '.join(names)}")
        for item in value:
            if item not in names:
                raise SceneError(f"{self.where} {unknown_name(key, item, names)}")
        return tuple(value)

    def vector(
        self,
        key: str,
        length: int | None = None,
        default: Any = REQUIRED,
        *,
        doc: str = "",
        **allowed: Any,
    ) -> tuple[Any, ...]:
        """Return a list of ``length`` numbers (of any number from one on, when None)."""
        span = Range(**allowed)
        wanted = f"a list of {length or 'one or more'} values, each {span.a_number}"
        value = self.raw(key, default, _said(doc, wanted))
        if not isinstance(value, list | tuple) or len(value) != (length or len(value) or 1):
            raise self.error(key, value, wanted)
        return self._each(key, value, span)

    def spread(self, key: str, default: tuple[float, ...], **allowed: Any) -> tuple[float, ...]:
        """Return one number for each of ``default``, given as one for all or as a list."""
        value, span, count = self.raw(key, default), Range(**allowed), len(default)
        if is_number(value):
            return self._each(key, [value], span) * count
        if not isinstance(value, list | tuple) or len(value) != count:
            raise self.error(key, value, f"{span.a_number} or a list of {count} of them")
        return self._each(key, value, span)

    def _each(self, key: str, values: Sequence[Any], span: Range) -> tuple[float, ...]:
        labels = [f"{self.where} {key}[{i}]" for i in range(len(values))]
        if len(values) == 1:
            labels = [f"{self.where} {key}"]
        return tuple(span.check(*pair, SceneError) for pair in zip(labels, values, strict=True))

    def error(self, key: str, value: Any, allowed: str) -> SceneError:
        """Return the error for a value that is not what is allowed."""
        count = f" ({len(value)} values)" if isinstance(value, list | tuple) else ""
        return SceneError(f"{self.where} {key} = {value!r}{count}: must be {allowed}")

    def finish(self) -> None:
        """Raise for the first key that nobody read, naming the nearest that is known."""
        for key in self._data:
            if key not in self.known:
                raise SceneError(unknown_name(f"key in {self.where}", key, self.known))


def _said(doc: str, wanted: str) -> str:
    """What a key means, where that is known, and what it must be."""
    return f"{doc}, {wanted}" if doc else wanted

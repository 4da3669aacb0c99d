"""Errors: what was given, what is allowed, what to try.

One tree: ``except SoftmpcError`` catches all of them, and `InputError` is what a user can mend.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches

__all__ = [
    "BuildError",
    "InputError",
    "ParameterError",
    "SceneError",
    "SoftmpcError",
    "SweepError",
    "WorkerKilledError",
    "errors_in",
    "is_interrupt",
    "nearest",
    "unknown_name",
]


class SoftmpcError(Exception):
    """Any error that softmpc raises on purpose."""


class InputError(SoftmpcError, ValueError):
    """Wrong input; the message says what was given, what is allowed and what to try."""


class ParameterError(InputError):
    """A physical parameter of the wrong type or outside its validity range."""


class SceneError(InputError):
    """A scene, or a scene file, that contradicts itself or has an unknown name."""


class BuildError(SoftmpcError):
    """The scene is valid but cannot run in the way that was asked."""


class SweepError(SoftmpcError):
    """A case of a sweep that failed, or workers that do not live."""


class WorkerKilledError(SweepError):
    """A case of a sweep, by its number, whose worker was killed every time."""

    def __init__(self, message: str, case: int) -> None:
        super().__init__(message)
        self.case = case


def is_interrupt(error: BaseException) -> bool:
    """Whether it is Ctrl-C, which CasADi turns into other errors."""
    cause: BaseException | None = error
    while cause:
        if isinstance(cause, KeyboardInterrupt) or "KeyboardInterrupt" in str(cause):
            return True
        cause = cause.__cause__ or cause.__context__
    return False


def nearest(name: str, allowed: Iterable[str], alike: float = 0.4) -> str | None:
    """Return the allowed name closest to ``name``, or None when none is alike (0: any, 1: same)."""
    by_lower = {candidate.lower(): candidate for candidate in allowed}
    found = get_close_matches(name.lower(), by_lower, n=1, cutoff=alike)
    return by_lower[found[0]] if found else None


def unknown_name(what: str, name: object, allowed: Iterable[str]) -> str:
    """Return the message for an unknown ``what``: its nearest allowed name, then all of them."""
    names = list(allowed)
    near = nearest(str(name), names)
    hint = f"did you mean {near!r}? " if near else ""
    return f"unknown {what}: {name!r}; {hint}allowed: {', '.join(names) or 'none'}"


@contextmanager
def errors_in(where: object) -> Iterator[None]:
    """Put ``where`` (a file, a table) before the message of an `InputError` or `BuildError`."""
    try:
        yield
    except (InputError, BuildError) as error:
        raise type(error)(f"{where}: {error}") from None

"""Files written whole or not at all, NPZ files read so too, and JSON that all programs read."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from softmpc.errors import InputError

__all__ = ["as_json", "reading_npz", "replacing"]

BROKEN = AttributeError, EOFError, KeyError, OSError, TypeError, ValueError


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """`with replacing(path) as beside`: what is written beside takes the place of `path`.

    A crash leaves the last good file; a folder that is missing is made. Raises `InputError` where
    nothing can be written.
    """
    path = Path(path)
    beside = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            beside.unlink(missing_ok=True)


@contextmanager
def reading_npz(
    path: str | os.PathLike[str], what: str, schemas: tuple[int, ...]
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """`with reading_npz(path, "simulation", (1, 2)) as (about, arrays)`: what a result has saved.

    Raises `InputError` for a file that is missing, broken, of another kind or of another schema,
    also where that shows only in the block.
    """
    import zipfile  # these are here, because `files` is imported by all
    import zlib

    import numpy as np

    try:
        if os.path.exists(path) and not zipfile.is_zipfile(path):
            raise ValueError("no NPZ file, or one that was cut off")
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        about = json.loads(str(arrays.pop("about")))
        if about.pop("schema", None) not in schemas:
            known = " and ".join(map(str, schemas)) + (" are" if len(schemas) > 1 else " is")
            raise InputError(f"{path}: is of another version; {known} known here")
        yield about, arrays
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except InputError:
        raise
    except (*BROKEN, zipfile.BadZipFile, zlib.error) as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else error
        raise InputError(f"{path}: is not a saved {what}: {reason}") from None


def as_json(data: Any, indent: int | None = None) -> str:
    """JSON of plain data and NumPy values; what is not finite becomes null."""
    return json.dumps(_plain(data), indent=indent, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)

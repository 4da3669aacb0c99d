"""`softmpc cache`: the compiled functions that are kept on this machine."""

from __future__ import annotations

import os
from pathlib import Path

import click

from softmpc.cli.common import Answer, answering, table

__all__ = ["command"]


@click.command("cache")
@click.option("--clear", is_flag=True, help="Remove all of them; what runs keeps what it has.")
@answering("cache")
def command(clear: bool, out: Path | None) -> Answer:
    """Show the compiled functions that are kept: folder, number, size, and the compiler."""
    from softmpc import library_cache
    from softmpc.compiled import compiler, default_mode
    from softmpc.compiler import why_none
    from softmpc.errors import InputError

    folder = library_cache.folder()
    there = next(place for place in (folder, *folder.parents) if os.path.exists(place))
    if not there.is_dir():
        raise InputError(
            f"{folder}: cannot be used, {there} is not a folder; SOFTMPC_CACHE names another"
        )
    try:
        removed = library_cache.clear() if clear else 0
    except OSError as error:
        raise InputError(f"{folder}: cannot be cleared: {error.strerror}") from None
    kept = library_cache.libraries()
    size = sum(library.stat().st_size for library in kept)
    found = compiler()
    data = {
        "folder": folder,
        "functions": len(kept),
        "bytes": size,
        "removed": removed,
        "compiler": str(found) if found else None,
        "flags": list(found.flags) if found else [],
        "mode": default_mode(),
    }
    rows: list[tuple[str, object]] = [
        ("folder", folder),
        ("functions", f"{len(kept)}, {size / 1e6:.1f} MB"),
        ("compiler", f"{found} {' '.join(found.flags)}" if found else f"none ({why_none()})"),
        ("mode", data["mode"]),
    ]
    if clear:
        rows.insert(1, ("removed", removed))
    return Answer(data, table(rows))

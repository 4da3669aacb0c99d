"""Where the cases of a command are done: --workers and --dask."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from softmpc.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["executor_for", "sweep_options"]

PATIENCE_S = 3.0


def sweep_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options --workers and --dask, for `executor_for`."""
    dask = click.option(
        "--dask", metavar="ADDRESS",
        help="Work on the workers of a Dask scheduler, tcp://HOST:8786, instead.",
    )  # fmt: skip
    workers = click.option(
        "--workers", type=click.IntRange(min=1), metavar="N",
        help="Processes to work in; 1: in this one.  [default: one a usable core]",
    )  # fmt: skip
    return workers(dask(command))


@contextmanager
def executor_for(workers: int | None, dask: str | None) -> Iterator[Executor | int | None]:
    """What `sweep` takes as its executor, as long as the context lasts.

    Raises `InputError` where both are given, and where Dask cannot be used.
    """
    if dask is None:
        yield workers
        return
    if workers is not None:
        raise InputError("give --workers or --dask: a Dask scheduler has its own workers")
    with _client(dask) as client:
        yield client.get_executor()


def _client(address: str) -> Any:
    """A Dask client that has workers."""
    import asyncio

    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask needs Dask: pip install 'softmpc[dask]'") from None
    where = f"--dask {address}"
    try:
        found = asyncio.run(asyncio.wait_for(_identity(address), PATIENCE_S))
    except (OSError, ValueError, NotImplementedError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else f"waited {PATIENCE_S:g} s"
        raise InputError(
            f"{where}: no scheduler answers ({reason}); `dask scheduler` starts one and prints "
            "its address"
        ) from None
    if not found.get("workers"):
        raise InputError(
            f"{where}: the scheduler has no workers; `dask worker {address}` starts one"
        )
    return Client(address, timeout=PATIENCE_S, set_as_default=False)


async def _identity(address: str) -> dict[str, Any]:
    """What a scheduler says about itself; a `Client` would wait for it without end."""
    from distributed import Security, rpc

    arguments = Security().get_connection_args("client")
    async with rpc(address, connection_args=arguments) as scheduler:
        return dict(await scheduler.identity())

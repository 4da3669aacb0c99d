"""Flight logs written, record by record."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from softmpc.codegen import flight_format as form
from softmpc.codegen.flight_format import (
    Header,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
)
from softmpc.errors import InputError

__all__ = ["Closing", "FlightWriter", "LogFile", "check_place"]

LOG = logging.getLogger(__name__)


def check_place(path: str | os.PathLike[str]) -> None:
    """Raise `InputError` where a log would replace a file that is something else."""
    try:
        with open(path, "rb") as file:
            found = file.read(len(form.MAGIC)) if Path(path).is_file() else b""
    except OSError:
        return  # not there; or it cannot be written either, which is said where it is begun
    if not form.MAGIC.startswith(found):
        raise InputError(
            f"{path}: is no flight log, and a log would replace it; name another file (--record)"
        )


class LogFile:
    """A file that is begun anew; what is put in is with the operating system at once.

    Where the disk takes no more the file ends, with a warning: nobody stops an arm for that. Raises
    `InputError` where it cannot be begun, or where a file of something else is.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        check_place(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "wb", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

    def put(self, data: bytes) -> None:
        """Add bytes."""
        try:
            while data and not self._file.closed:
                data = data[self._file.write(data) :]
        except OSError as error:
            LOG.warning("%s: the log ends here: %s", self.path, error.strerror)
            self._file.close()

    def close(self) -> None:
        """No more."""
        self._file.close()


class Closing:
    """`with` ends it: what has a method `close`."""

    def close(self) -> None:
        """Nothing more is to come."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class FlightWriter(Closing):
    """Writes a log; every record is with the operating system when `write` returns.

    Steps are numbered here. Use it in a `with` block, or `close` it.
    """

    def __init__(self, path: str | os.PathLike[str], header: Header) -> None:
        self.header, self.number = header, 0
        self._before: StepRecord | None = None
        self._limits, self._settings = Limits(), Settings()
        self._file = LogFile(path)
        self._put(form.put_header(header))

    def step(self, step: StepRecord) -> None:
        """Add a step; its number is the next one."""
        step = replace(step, number=self.number)
        self._put(form.put_step(self.header, step, self._before))
        self._before, self.number = step, self.number + 1

    def reset(self) -> None:
        """The controller has forgotten everything, what a user has set too."""
        self._before = None
        self._limits, self._settings = Limits(), Settings()
        self._put(form.put_reset(Reset(self.number)))

    def snapshot(self, snapshot: Snapshot) -> None:
        """What the controller remembers after the last step; its number is the next one.

        The next step is written in full then, and what a user has set once more, so that a reader
        can begin here.
        """
        self._before = None
        records = [form.put_snapshot(self.header, replace(snapshot, number=self.number))]
        if any(part is not None for part in self._limits.each):
            records.append(form.put_limits(self.header, self._limits))
        if self._settings != Settings():
            records.append(form.put_settings(self._settings))
        self._put(b"".join(records))

    def limits(self, limits: Limits) -> None:
        """A user has set limits."""
        self._limits = limits
        self._put(form.put_limits(self.header, limits))

    def settings(self, settings: Settings) -> None:
        """A user has set something else."""
        self._settings = settings
        self._put(form.put_settings(settings))

    def _put(self, data: bytes) -> None:
        self._file.put(data)

    def close(self) -> None:
        """No more records."""
        self._file.close()

"""Who controls instead of the controller in Python: that in C, or one that is recorded."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from softmpc.codegen.building import require_compiler
from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.compiled_pilot import CompiledPilot
from softmpc.codegen.estimator_pilot import files
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.flight_writer import check_place
from softmpc.codegen.generate import generate
from softmpc.control.tracking import Setup
from softmpc.rig.rigging import Rig

__all__ = ["InTheLoop"]


@dataclass(frozen=True)
class InTheLoop:
    """`with InTheLoop(...)(setup) as controller`, see `softmpc.control.tracking.track_file`.

    With `code` that is the controller in C, `single` in float, in the same loop as that in Python;
    with `log` it writes a flight log there, which says that it is of the file `scene`. Raises
    `BuildError` where there is no compiler, and `InputError` where the log would replace another
    file, before anything takes time.
    """

    code: bool = True
    single: bool = False
    log: Path | None = None
    scene: Path | str = ""

    def __post_init__(self) -> None:
        if self.code:
            require_compiler()
        if self.log is not None:
            check_place(self.log)

    @contextmanager
    def __call__(self, setup: Setup) -> Iterator[Any]:
        """The controller of a task; its folder is gone afterwards."""
        with tempfile.TemporaryDirectory(prefix="softmpc-") as folder:
            controller: Any = setup.controller
            if self.code:
                made = generate(setup, Path(folder) / "controller", demo=False)
                controller = CompiledController(
                    made.folder,
                    setup.controller.transcription,
                    single=self.single,
                    budget=setup.task.controller.budget,
                )
            if self.log is None:
                yield controller
                return
            with record(controller, self.log, self.scene) as recorded:
                yield recorded

    @contextmanager
    def on_rig(self, rig: Rig) -> Iterator[Rig]:
        """The rig under the whole pilot in C: estimator, supervision and controller.

        A log records what the controller is told, so with one the estimator stays in Python.
        """
        if self.log is not None or not self.code:
            with self(rig.setup) as rig.pilot.mpc:
                yield rig
            return
        with tempfile.TemporaryDirectory(prefix="softmpc-") as folder:
            beside = files(rig.pilot)
            made = generate(rig.setup, Path(folder) / "pilot", demo=False, beside=beside)
            pilot: Any = CompiledPilot(made.folder, rig.pilot, single=self.single)
            yield replace(rig, pilot=pilot)

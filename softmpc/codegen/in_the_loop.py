"""Who controls instead of the controller in Python: that in C, or one that is recorded."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.generate import generate
from softmpc.control.tracking import Setup

__all__ = ["InTheLoop"]


@dataclass(frozen=True)
class InTheLoop:
    """`with InTheLoop(...)(setup) as controller`, see `softmpc.control.tracking.track_file`.

    With `code` that is the controller in C, `single` in float, in the same loop as that in Python;
    with `log` it writes a flight log there, which says that it is of the file `scene`.
    """

    code: bool = True
    single: bool = False
    log: Path | None = None
    scene: Path | str = ""

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

"""What scene files cannot say: how the arm's Jacobian is made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from softmpc.accuracy.printed_rates import with_printed_rates
from softmpc.errors import SceneError, unknown_name
from softmpc.model.chain import State
from softmpc.model.formulations import VirtualPower
from softmpc.model.jacobians import Jacobians, residual_of, split_pressures
from softmpc.model.model import Model, build
from softmpc.model.scene import MAX_SEGMENTS, Scene

__all__ = ["COMPILE", "DERIVATIVES", "PRINTED_RATES", "model_with"]

WRITTEN_OUT, LOOPS, PLAIN = "written out", "in loops", "plain differentiation"
DERIVATIVES = (WRITTEN_OUT, LOOPS, PLAIN)
PRINTED_RATES = "printed rates"  # ω = dw/dt passed on from segment to segment
COMPILE = {"virtual machine": "never", "compiled": "require"}  # name -> mode of `compiled`
NAMES = ("by_q", "by_dq", "by_ddq", "by_p")


def model_with(scene: Scene, variant: str) -> Model:
    """The model of a scene, its Jacobian made in the way that `variant` names; "" is the model's.

    Raises `SceneError` for an unknown variant, and where the scene leaves no choice.
    """
    if variant == PRINTED_RATES:
        return with_printed_rates(scene)
    model = build(scene)
    if not variant:
        return model
    if variant not in DERIVATIVES:
        raise SceneError(unknown_name("variant", variant, [*DERIVATIVES, PRINTED_RATES]))
    if not isinstance(scene.formulation, VirtualPower):
        raise SceneError(
            f"variant {variant!r}: formulation {scene.formulation.name!r} has one way to its "
            "derivatives; take virtual-power"
        )
    maker = _plainly if variant == PLAIN else _by_recursion
    model.__dict__["residual_jacobian"] = maker(model, variant)  # in the place of its own
    return model


def _by_recursion(model: Model, variant: str) -> ca.Function:
    """Over the segments, in one graph or by small functions that are called in loops."""
    all_segments = MAX_SEGMENTS * len(model.scene.manipulator.sections)
    most = all_segments if variant == WRITTEN_OUT else 0
    j = Jacobians(model.chain, *_symbols(model), most_written_out=most)
    if j.looped != (variant == LOOPS):
        raise SceneError(f"variant {variant!r}: an effect of this scene needs {WRITTEN_OUT!r}")
    return _function(j.symbols, [*j.by_motion(), j.by_pressures()])


def _plainly(model: Model, _: str) -> ca.Function:
    """CasADi differentiates the whole chain."""
    state, p = _symbols(model)
    r = residual_of(model.chain, state, split_pressures(model.chain, p))
    blocks = [ca.sparsify(ca.jacobian(r, x)) for x in (*state.columns, p)]
    return _function(vars(state) | {"p": p}, blocks)


def _symbols(model: Model) -> tuple[State, ca.SX]:
    state = State(*(ca.SX.sym(name, model.strains) for name in ("q", "dq", "ddq")))
    return state, ca.SX.sym("p", model.scene.manipulator.units)


def _function(symbols: dict[str, Any], blocks: Sequence[Any]) -> ca.Function:
    arguments = list(symbols.values())
    return ca.Function("residual_jacobian", arguments, blocks, [*symbols], NAMES, {"cse": True})

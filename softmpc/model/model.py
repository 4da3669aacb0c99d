"""A scene as CasADi functions: what `build` returns.

Functions are made when first used and kept, so a study of the statics never pays for the dynamics.
All arguments and results are named, in SI, with the shapes given in each docstring: n strains
(`q`), m unit pressures (`p`, Pa), k inputs (`u`, N·m or Pa), h drive states (`z`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from softmpc.model import energy, newton_euler, places, virtual_power
from softmpc.model.chain import Chain, State
from softmpc.model.counting import executed
from softmpc.model.drive_functions import DriveFunctions, sparse_times
from softmpc.model.effects import Effect, TipLoad
from softmpc.model.formulations import NewtonEuler
from softmpc.model.hydraulics import DriveMatrices
from softmpc.model.jacobians import Jacobians, residual_of, split_pressures
from softmpc.model.layout import Layout
from softmpc.model.report import COUNTED, describe, massless_strains, require_mass
from softmpc.model.scene import Scene

__all__ = ["Model", "build", "sparse_times"]


def build(scene: Scene) -> Model:
    """The model of a scene; raises `BuildError` where it cannot be made."""
    drive = scene.actuation.matrices(scene.manipulator, scene.effects)
    return Model(scene, Chain(scene), drive)


@dataclass(frozen=True, eq=False, repr=False)
class Model(DriveFunctions):
    """An arm as CasADi functions. Immutable; make it with `build(scene)`."""

    scene: Scene
    chain: Chain
    drive: DriveMatrices

    @cached_property
    def layout(self) -> Layout:
        """Names, units and scales of states, inputs and equations."""
        return Layout.of(self.scene)

    @property
    def strains(self) -> int:
        """n, the number of strains."""
        return self.chain.size

    @property
    def order(self) -> int:
        """2 with inertia, 1 for a damped quasi-static arm, 0 where the arm follows at once."""
        if self.chain.dynamic:
            return 2
        return 0 if self.residual.sparsity_jac(1, 0).nnz() == 0 else 1

    # --- symbols -------------------------------------------------------------------------------

    @cached_property
    def _state(self) -> State:
        return State(*(ca.SX.sym(name, self.strains) for name in ("q", "dq", "ddq")))

    @cached_property
    def _rest(self) -> State:
        return State(self._state.q)

    @cached_property
    def _p(self) -> ca.SX:
        return ca.SX.sym("p", self.scene.manipulator.units)

    @cached_property
    def _pressures(self) -> list[Any]:
        return split_pressures(self.chain, self._p)

    @property
    def _printed(self) -> bool:
        return isinstance(self.scene.formulation, NewtonEuler)

    def _function(self, name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> ca.Function:
        return ca.Function(
            name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs], {"cse": True}
        )

    @property
    def _symbols(self) -> dict[str, Any]:
        s = self._state
        return {"q": s.q, "dq": s.dq, "ddq": s.ddq, "p": self._p}

    # --- equations of motion -------------------------------------------------------------------

    @cached_property
    def _balance(self) -> newton_euler.Balance:
        return newton_euler.equations(self.chain, self._state, self._pressures)

    def _residual_at(self, state: State) -> ca.SX:
        if self._printed:
            b = self._balance
            r = b.M @ self._state.ddq + b.C @ self._state.dq + b.N - b.tau
            if state is self._state:
                return r
            rates = ca.vertcat(self._state.dq, self._state.ddq)
            return ca.substitute(r, rates, ca.SX.zeros(2 * self.strains))
        return residual_of(self.chain, state, self._pressures)

    @cached_property
    def _jacobians(self) -> Jacobians:
        return Jacobians(self.chain, self._state, self._p)

    @cached_property
    def residual(self) -> ca.Function:
        """r(q, dq, ddq, p) = M ddq + C dq + N - τ (n), zero along a motion."""
        return self._function("residual", self._symbols, {"r": self._residual_at(self._state)})

    @cached_property
    def residual_jacobian(self) -> ca.Function:
        """(q, dq, ddq, p) -> ∂r/∂q, ∂r/∂dq, ∂r/∂ddq (n×n) and ∂r/∂p (n×m)."""
        names = ("by_q", "by_dq", "by_ddq", "by_p")
        if self._printed:
            r, symbols = self._residual_at(self._state), self._symbols
            blocks = [ca.sparsify(ca.jacobian(r, x)) for x in self._state.columns]
            blocks.append(ca.jacobian(r, self._p))
        else:
            j = self._jacobians
            blocks, symbols = [*j.by_motion(), j.by_pressures()], j.symbols
        return self._function("residual_jacobian", symbols, dict(zip(names, blocks, strict=True)))

    @cached_property
    def residual_along(self) -> ca.Function:
        """(q, dq, ddq, p) and a direction in each -> directional derivative of r (n), O(n)."""
        along = {f"along_{k}": ca.SX.sym(f"along_{k}", *v.shape) for k, v in self._symbols.items()}
        here, there = (ca.vertcat(*symbols.values()) for symbols in (self._symbols, along))
        slope = ca.jtimes(self._residual_at(self._state), here, there)
        return self._function("residual_along", {**self._symbols, **along}, {"dr": slope})

    @cached_property
    def M(self) -> ca.Function:
        """Inertia matrix M(q) (n×n); empty of nonzeros without inertia."""
        if self._printed:
            return self._function("M", {"q": self._state.q}, {"M": self._balance.M})
        state = self._jacobians.state
        return self._function("M", {"q": state.q}, {"M": self._jacobians.inertia(State(state.q))})

    @cached_property
    def C(self) -> ca.Function:
        """Coriolis and damping matrix C(q, dq) (n×n); Ṁ - 2C is skew but for damping."""
        s = self._state if self._printed else self._jacobians.state
        matrix = self._balance.C if self._printed else self._jacobians.rates()
        return self._function("C", {"q": s.q, "dq": s.dq}, {"C": matrix})

    @cached_property
    def N(self) -> ca.Function:
        """Elastic forces less weight, N(q) (n)."""
        vector = self._balance.N if self._printed else self._position_forces(None)
        return self._function("N", {"q": self._state.q}, {"N": vector})

    @cached_property
    def tau(self) -> ca.Function:
        """Drive and load, τ(q, p) (n)."""
        vector = self._balance.tau if self._printed else self._input_forces(None)
        return self._function("tau", {"q": self._state.q, "p": self._p}, {"tau": vector})

    @cached_property
    def equations(self) -> ca.Function:
        """(q, dq, p) -> M, C, N, τ of (26) in one pass, cheaper than one by one."""
        symbols = self._symbols if self._printed else self._jacobians.symbols
        q, dq, p = (symbols[name] for name in ("q", "dq", "p"))
        if self._printed or self._jacobians.looped:
            terms = [self.M(q), self.C(q, dq), self.N(q), self.tau(q, p)]
        else:
            inertia = self._jacobians.inertia(State(q, dq))
            highest = 7  # the same Stumpff functions as the derivatives use
            rest = [self._position_forces(highest), self._input_forces(highest)]
            terms = [inertia, self._jacobians.rates(), *rest]
        outputs = dict(zip(("M", "C", "N", "tau"), terms, strict=True))
        return self._function("equations", {"q": q, "dq": dq, "p": p}, outputs)

    def _position_forces(self, highest: int | None) -> ca.SX:
        none = [None] * len(self._pressures)
        return self._part(lambda e: not isinstance(e, TipLoad), none, True, highest)

    def _input_forces(self, highest: int | None) -> ca.SX:
        return -self._part(lambda e: isinstance(e, TipLoad), self._pressures, False, highest)

    def _part(
        self,
        keep: Callable[[Effect], bool],
        pressures: list[Any],
        elastic: bool,
        highest: int | None,
    ) -> ca.SX:
        """The residual at rest of only some effects."""
        chain = Chain(self.scene, tuple(e for e in self.scene.effects if keep(e)))
        links = chain.forward(self._rest, highest)
        return virtual_power.residual(chain, links, self._rest, pressures, elastic)

    # --- at rest -------------------------------------------------------------------------------

    @cached_property
    def balance(self) -> ca.Function:
        """r(q, p) = N - τ (n): the residual at rest."""
        symbols = {"q": self._state.q, "p": self._p}
        return self._function("balance", symbols, {"r": self._residual_at(self._rest)})

    @cached_property
    def stiffness(self) -> ca.Function:
        """(q, p) -> tangent stiffness ∂(N - τ)/∂q (n×n), and ∂(N - τ)/∂p (n×m)."""
        if self._printed:
            r, symbols = self._residual_at(self._rest), self._symbols
            K, by_p = ca.sparsify(ca.jacobian(r, self._state.q)), ca.jacobian(r, self._p)
        else:
            symbols = self._jacobians.symbols
            K, by_p = self._jacobians.stiffness(), self._jacobians.by_pressures()
        inputs = {name: symbols[name] for name in ("q", "p")}
        return self._function("stiffness", inputs, {"K": K, "by_p": by_p})

    # --- motion --------------------------------------------------------------------------------

    @cached_property
    def massless(self) -> tuple[str, ...]:
        """Names of strains without mass: M is singular in their directions."""
        return massless_strains(self)

    def require_mass(self, what: str) -> None:
        """Raise `BuildError` if `what` cannot run because M is singular or absent."""
        require_mass(self, what)

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """ddq(q, dq, p) (n)."""
        self.require_mass("forward dynamics")
        names = ("q", "dq", "p")
        x = {name: ca.MX.sym(name, self._symbols[name].shape[0]) for name in names}
        bias = self.residual(x["q"], x["dq"], 0, x["p"])
        ddq = ca.solve(self.M(x["q"]), -bias, "qr")
        return ca.Function("forward_dynamics", [*x.values()], [ddq], [*x], ["ddq"])

    @cached_property
    def x_dot(self) -> ca.Function:
        """State-space model dx/dt(x, u) with x = (q, dq, z): the arm and its drive."""
        n, h = self.strains, len(self.drive.A)
        x, u = ca.MX.sym("x", 2 * n + h), ca.MX.sym("u", self.drive.D.shape[1])
        q, dq, z = ca.vertsplit(x, [0, n, 2 * n, 2 * n + h])
        ddq = self.forward_dynamics(q, dq, self.pressures(z, u))
        dz = self.drive_rate(z, u, q, dq)
        return ca.Function("x_dot", [x, u], [ca.vertcat(dq, ddq, dz)], ["x", "u"], ["x_dot"])

    # --- places --------------------------------------------------------------------------------

    @cached_property
    def frames(self) -> ca.Function:
        """q -> section tips (3×S, m, base frame), and their rotations side by side (3×3S)."""
        tips, rotations = places.section_ends(self.chain, self._rest)
        outputs = {
            "tips": ca.densify(ca.horzcat(*tips)),
            "rotations": ca.densify(ca.horzcat(*rotations)),
        }
        return self._function("frames", {"q": self._state.q}, outputs)

    @cached_property
    def tip(self) -> ca.Function:
        """q -> place of the arm's tip (3, m, base frame)."""
        place = ca.densify(places.section_ends(self.chain, self._rest)[0][-1])
        return self._function("tip", {"q": self._state.q}, {"tip": place})

    @cached_property
    def tip_jacobian(self) -> ca.Function:
        """q -> ∂(section tips)/∂q, section after section (3S×n)."""
        tips, _ = places.section_ends(self.chain, self._rest)
        outputs = {"J": ca.jacobian(ca.vertcat(*tips), self._state.q)}
        return self._function("tip_jacobian", {"q": self._state.q}, outputs)

    @cached_property
    def centerline(self) -> ca.Function:
        """q -> points along the arm (3×(10 a segment + 1)), for pictures."""
        points = places.centerline(self.chain, self._rest)
        return self._function("centerline", {"q": self._state.q}, {"points": points})

    @cached_property
    def energies(self) -> ca.Function:
        """(q, dq) -> energies in J by name: kinetic, gravity, elastic, load, those that exist."""
        outputs = energy.energies(self.chain, places.poses(self.chain, self._state))
        return self._function("energies", {"q": self._state.q, "dq": self._state.dq}, outputs)

    @cached_property
    def powers(self) -> ca.Function:
        """(q, dq, p) -> power put in, in W by name: drive and damping, those that exist."""
        inputs = {"q": self._state.q, "dq": self._state.dq, "p": self._p}
        poses = places.poses(self.chain, self._state)
        outputs = energy.powers(self.chain, poses, self._state, self._pressures)
        return self._function("powers", inputs, outputs)

    # --- for people ----------------------------------------------------------------------------

    def instructions(self) -> dict[str, int]:
        """Instructions executed in one call of each function a scene needs, by name."""
        return {name: executed(getattr(self, name)) for name in COUNTED}

    def __repr__(self) -> str:
        return describe(self)

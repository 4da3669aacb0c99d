"""The arm and its optimal-control problem as acados takes them; runs where acados is installed.

State (scaled): strains, rates, drive, and the input before, w. Inputs: torques, and the slack that
all pressure limits of an interval share. The torque rate is a cost of u - w. For w the equation of
motion is 0 = u - w: Radau IIA ends where that holds, so w at the next node is u.

Integrators: GNSF has everything that is linear as constant matrices and solves for the arm's
accelerations alone, by our residual and Jacobian. IRK gets all as one implicit equation, and its
derivatives from CasADi, as acados makes them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

__all__ = ["Task", "make_ocp"]


class Task:
    """Functions and numbers of a problem, see `tests.benchmarks.acados_task`."""

    def __init__(self, folder: Path) -> None:
        for name, value in np.load(folder / "problem.npz").items():
            setattr(self, name.replace(" ", "_"), value if value.shape else value.item())
        self.f = {name: ca.Function.load(str(folder / f"{name}.casadi"))
                  for name in ("residual", "residual_jacobian", "tip")}  # fmt: skip
        self.nx, self.inputs = len(self.x_scale), len(self.u_scale)

    def __getattr__(self, name: str) -> Any:  # the numbers
        raise AttributeError(name)

    def split(self, x: Any) -> list[Any]:
        return ca.vertsplit(x, [0, self.n, 2 * self.n, self.nx])

    def si(self, q: Any, dq: Any, ddq: Any, p: Any) -> tuple[Any, ...]:
        scale = self.x_scale[: self.n], self.x_scale[self.n : 2 * self.n]
        return q * scale[0], dq * scale[1], ddq * scale[1], p * self.p_scale

    def residual(self, *at: Any) -> Any:
        return self.f["residual"](*self.si(*at)) / self.r_scale

    def jacobian(self, *at: Any) -> list[Any]:
        """By q, dq, ddq and p, all scaled."""
        scales = self.si(1, 1, 1, 1)
        rows = ca.diag(ca.DM(1 / self.r_scale))
        blocks = self.f["residual_jacobian"](*self.si(*at))
        return [rows @ J @ ca.diag(ca.DM(s)) for J, s in zip(blocks, scales, strict=True)]


def make_ocp(task: Task, folder: Path, options: dict[str, Any]) -> Any:
    """The problem with these options of the solver."""
    from acados.acados_template import AcadosModel, AcadosOcp

    ocp, model = AcadosOcp(), AcadosModel()
    sx, m = ca.SX.sym, task.inputs
    x, w, u = sx("x", task.nx), sx("w", m), sx("u", m + 1)
    dx, dw = sx("dx", task.nx), sx("dw", m)
    model.name = "arm"
    model.x, model.u, model.xdot = ca.vertcat(x, w), u, ca.vertcat(dx, dw)
    model.p, model.z = sx("p", 0, 0), sx("z", 0, 0)
    model.f_impl_expr = _implicit(task, x, w, u, dx)
    ocp.model, ocp.dims.N, ocp.dims.nu = model, task.N, m + 1
    _costs(task, ocp, x, w, u)
    _limits(task, ocp)
    solver = ocp.solver_options
    solver.tf, solver.nlp_solver_type = task.N * task.step, "SQP_RTI"
    solver.hessian_approx, solver.collocation_type = "GAUSS_NEWTON", "GAUSS_RADAU_IIA"
    solver.sim_method_num_stages, solver.sim_method_num_steps = 2, 1
    solver.print_level, solver.qp_solver_iter_max = 0, 100
    for name, value in options.items():
        setattr(solver, name, value)
    if solver.integrator_type == "GNSF":
        ocp.gnsf_model = _gnsf(task)
    ocp.code_export_directory = str(folder / "c")
    return ocp


def _implicit(task: Task, x: Any, w: Any, u: Any, dx: Any) -> Any:
    """The motion as one implicit equation; rows in steps, so that they are of order one."""
    q, dq, z = task.split(x)
    q_dot, dq_dot, z_dot = task.split(dx)
    q_scale, dq_scale = task.x_scale[: task.n], task.x_scale[task.n : 2 * task.n]
    A, B, C = (ca.sparsify(ca.DM(M)) for M in (task.A, task.B, task.C))
    inputs = u[: task.inputs]
    return ca.vertcat(
        task.step * (q_dot - dq * (dq_scale / q_scale)),
        task.residual(q, dq, dq_dot, C @ z),
        task.step * (z_dot - A @ z - B @ inputs),
        w - inputs,
    )


def _gnsf(task: Task) -> dict[str, str]:
    """E x' = A x + B u + C φ(y), y = L x + L' x', φ = M y'' - r(y); w = u in the linear output."""
    n, nx, m, nu = task.n, task.nx, task.inputs, task.inputs + 1
    y, none = ca.SX.sym("y", 3 * n + m), ca.SX.sym("none", 0, 0)
    at = ca.vertsplit(y, [0, n, 2 * n, 3 * n, 3 * n + m])
    M = task.jacobian(*(0.1 * ca.DM.ones(k) for k in (n, n, n, m)))[2]  # any regular one will do
    phi = M @ at[2] - task.residual(*at)
    J = task.jacobian(*at)
    slope = ca.densify(ca.horzcat(-J[0], -J[1], M - J[2], -J[3]))
    E, A, B, C = np.eye(nx), np.zeros((nx, nx)), np.zeros((nx, nu)), np.zeros((nx, n))
    rates = slice(n, 2 * n)
    E[rates, rates], C[rates] = np.array(M), np.eye(n)
    A[:n, rates] = np.diag(task.x_scale[rates] / task.x_scale[:n])
    A[2 * n :, 2 * n :], B[2 * n :, :m] = task.A, task.B
    L, L_dot = np.zeros((3 * n + m, nx)), np.zeros((3 * n + m, nx))
    L[: 2 * n, : 2 * n], L_dot[2 * n : 3 * n, rates] = np.eye(2 * n), np.eye(n)
    L[3 * n :, 2 * n :] = task.C
    dm, B_out = ca.DM, np.eye(m, nu)
    matrices = [
        dm(A), dm(B), dm(C), dm(E), dm(L), dm(L_dot), dm(3 * n + m, 0), dm(0, nu), -dm.eye(m),
        dm(nx, 1), dm(m, m), dm(B_out), dm(0), dm(0), dm(np.arange(nx + m)), dm(0, 1), dm(m, 1),
    ]  # fmt: skip
    cse = {"cse": True}
    functions = {
        "phi_fun": ca.Function("phi_fun", [y, none, none], [phi], cse),
        "phi_fun_jac_y": ca.Function("phi_fun_jac_y", [y, none, none], [phi, slope], cse),
        "phi_jac_y_uhat": ca.Function("phi_jac", [y, none, none], [slope, ca.SX(n, 0)], cse),
        "get_matrices_fun": ca.Function("matrices", [ca.SX.sym("dummy")], matrices),
    }
    return {name: function.serialize() for name, function in functions.items()}


def _costs(task: Task, ocp: Any, x: Any, w: Any, u: Any) -> None:
    """Residuals; acados weighs those of an interval by its length, which ours do not."""
    q, dq, _ = task.split(x)
    m, cost, model = task.inputs, ocp.cost, ocp.model
    of_state = [task.f["tip"](q * task.x_scale[: task.n]) / task.by_tip, dq / task.by_strain_rate]
    # In units of its price, ½ s² + 0.1 s is a square too: ½ (s + 0.1)².
    of_input = [u[:m] / task.by_torque, (u[:m] - w) / task.by_torque_rate, u[m]]
    model.cost_y_expr_0, model.cost_y_expr_e = ca.vertcat(*of_input), ca.vertcat(*of_state)
    model.cost_y_expr = ca.vertcat(*of_state, *of_input)
    for kind, weight in (("", 1 / task.step), ("_0", 1 / task.step), ("_e", 1.0)):
        size = getattr(model, f"cost_y_expr{kind}").numel()
        aim = np.zeros(size)
        if kind != "_e":
            aim[-1] = -task.soft * task.price
        setattr(cost, f"cost_type{kind}", "NONLINEAR_LS")
        setattr(cost, f"W{kind}", weight * np.eye(size))
        setattr(cost, f"yref{kind}", aim)


def _limits(task: Task, ocp: Any) -> None:
    """Torque and slack are bounded; pressures at the end of an interval are linear in (x, u)."""
    m, limits = task.inputs, ocp.constraints
    far = 1e9
    limits.x0 = np.zeros(task.nx + m)
    limits.idxbu = np.arange(m + 1)
    limits.lbu = np.append(task.torque[0] / task.u_scale, 0.0)
    limits.ubu = np.append(task.torque[1] / task.u_scale, far)
    by_x = np.hstack([np.zeros((m, 2 * task.n)), task.p_by_z, np.zeros((m, m))])
    slack = task.soft * np.ones((m, 1))
    limits.C = np.vstack([by_x, by_x])
    limits.D = np.vstack([np.hstack([task.p_by_u, slack]), np.hstack([task.p_by_u, -slack])])
    low, high = task.pressure[0] / task.p_scale, task.pressure[1] / task.p_scale
    limits.lg = np.append(low, np.full(m, -far))
    limits.ug = np.append(np.full(m, far), high)

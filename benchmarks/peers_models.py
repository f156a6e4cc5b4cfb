"""The same machines in the neighbouring tools: Pinocchio, MuJoCo and Drake. Each may be missing.

The tree is that of the mechanism, motion by motion, in the order of the links; the closures are points that coincide.
The platform hangs on three slides and three hinges in the order of its coordinates, so that the tools have our very
variables and their constraint Jacobians can be compared with ours.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import paraopt as po
from paraopt.mechanism import Base, Coincidence, Link, Series

Array = NDArray[np.float64]
Evaluate = Callable[[Array], Array]
Peer = tuple[Evaluate, list[int]]
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def load_peer(name: str) -> ModuleType | None:
    """Import a peer; None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def pinocchio_jacobian(mechanism: po.Mechanism) -> Peer | None:
    """Build what gives Pinocchio's constraint Jacobian at one point, and our place of each of its variables."""
    pin = load_peer("pinocchio")
    if pin is None:
        return None
    model = pin.Model()
    carriers: dict[str, tuple[int, Any]] = {}
    for link in mechanism.ordered_links:
        joint, placement = carriers[link.father] if isinstance(link, Series) else (0, pin.SE3.Identity())
        placement = placement * pin.SE3(*_placement(link))
        for motion in link.motions:
            kind = ("JointModelR" if motion.kind == "angle" else "JointModelP") + motion.axis.upper()
            joint = model.addJoint(joint, getattr(pin, kind)(), placement, motion.name)
            placement = pin.SE3.Identity()
        carriers[link.name] = joint, placement
    constraints = pin.StdVec_RigidConstraintModel()
    for A, p_A, B, p_B in _ties(mechanism):
        (joint_A, X_A), (joint_B, X_B) = carriers[A], carriers[B]
        at_A, at_B = X_A * pin.SE3(np.eye(3), p_A), X_B * pin.SE3(np.eye(3), p_B)
        constraints.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, joint_A, at_A, joint_B, at_B))
    data, room = model.createData(), pin.StdVec_RigidConstraintData()
    for constraint in constraints:
        room.append(constraint.createData())
    pairs = list(zip(constraints, room, strict=True))

    def evaluate(q: Array) -> Array:
        pin.computeJointJacobians(model, data, q)
        for constraint, kept in pairs:
            constraint.calc(model, data, kept)
        J: Array = pin.getConstraintsJacobian(model, data, constraints, room)
        return J

    names = sorted(
        (name for name in model.names if name != "universe"), key=lambda n: model.idx_qs[model.getJointId(n)]
    )
    return evaluate, mechanism.indices(names)


def mujoco_jacobian(mechanism: po.Mechanism) -> Peer | None:
    """Build what gives MuJoCo's Jacobian of the equality constraints, and our place of each of its variables."""
    mujoco = load_peer("mujoco")
    if mujoco is None:
        return None
    spec = mujoco.MjSpec()
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.gravity = np.zeros(3)
    bodies: dict[str, Any] = {}
    for link in mechanism.ordered_links:
        father = bodies[link.father] if isinstance(link, Series) else spec.worldbody
        R, p = _placement(link)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, R.ravel())
        body = bodies[link.name] = father.add_body(name=link.name, pos=p, quat=quaternion)
        for motion in link.motions:
            kind = mujoco.mjtJoint.mjJNT_HINGE if motion.kind == "angle" else mujoco.mjtJoint.mjJNT_SLIDE
            body.add_joint(name=motion.name, type=kind, axis=_AXES[motion.axis])
        # MuJoCo wants mass where something moves
        body.mass, body.inertia, body.explicitinertial = 1.0, np.ones(3), True
    for k, (A, p_A, B, p_B) in enumerate(_ties(mechanism)):
        bodies[A].add_site(name=f"{k}A", pos=p_A)
        bodies[B].add_site(name=f"{k}B", pos=p_B)
        spec.add_equality(
            name=str(k), type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=f"{k}A", name2=f"{k}B"
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def evaluate(q: Array) -> Array:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeConstraint(model, data)
        J: Array = data.efc_J.reshape(-1, model.nv)
        return J

    return evaluate, mechanism.indices([model.joint(k).name for k in range(model.njnt)])


def same_motions(ours: Array, theirs: Array) -> float:
    """Give the sine of the largest angle between the row spaces of two constraint Jacobians at a closed point [1]."""

    def space(J: Array) -> Array:
        _, s, Vt = np.linalg.svd(J)
        return Vt[: int(np.count_nonzero(s > 1e-8 * s[0]))]

    U, V = space(ours), space(theirs)
    if len(U) != len(V):
        return 1.0
    return float(np.linalg.norm(U - (U @ V.T) @ V, 2))


class DrakeProgram:
    """Solve `F(z) = 0` for the variables that are not imposed, by a solver of Drake.

    Args:
        F: Residual as a CasADi function of z; scaled.
        residual: Compiled F.
        jacobian: Compiled dF/dz.
        imposed: Places of the imposed variables in z.
        form: "callback": the compiled functions, called by the solver from Python; "symbolic": Drake's own expressions.
        solver: "SNOPT" or "IPOPT".
        tolerance: Bound on the residual [1].
    """

    def __init__(
        self, F: ca.Function, residual: Evaluate, jacobian: Evaluate, imposed: list[int], form: str, solver: str,
        tolerance: float,
    ) -> None:  # fmt: skip
        solvers = importlib.import_module("pydrake.solvers")
        autodiff = importlib.import_module("pydrake.autodiffutils")
        n, rows = F.numel_in(0), F.numel_out(0)
        self._program = solvers.MathematicalProgram()
        self._z = self._program.NewContinuousVariables(n, "z")
        self._imposed = imposed
        self._held = self._program.AddBoundingBoxConstraint(np.zeros(len(imposed)), np.zeros(len(imposed)),
                                                            self._z[imposed])  # fmt: skip
        if form == "symbolic":
            for expression in _as_symbolic(F, self._z):
                self._program.AddConstraint(expression, 0.0, 0.0)
        else:

            def evaluate(z: NDArray[Any]) -> NDArray[Any]:
                if z.dtype != object:
                    return residual(z)
                value = autodiff.ExtractValue(z)[:, 0]
                gradient = jacobian(value) @ autodiff.ExtractGradient(z)
                return autodiff.InitializeAutoDiff(residual(value), gradient=gradient)[:, 0]

            self._program.AddConstraint(evaluate, np.zeros(rows), np.zeros(rows), self._z)
        self._options = solvers.SolverOptions()
        if solver == "SNOPT":
            self._solver = solvers.SnoptSolver()
            self._options.SetOption(self._solver.solver_id(), "Major feasibility tolerance", tolerance)
            self._options.SetOption(self._solver.solver_id(), "Minor feasibility tolerance", tolerance)
        else:
            self._solver = solvers.IpoptSolver()
            for name in ("tol", "constr_viol_tol", "acceptable_tol", "acceptable_constr_viol_tol"):
                self._options.SetOption(self._solver.solver_id(), name, tolerance)

    def __call__(self, start: Array) -> Array:
        """Solve from a start that holds the imposed values."""
        self._held.evaluator().set_bounds(start[self._imposed], start[self._imposed])
        z: Array = self._solver.Solve(self._program, start, self._options).GetSolution(self._z)
        return z


def _as_symbolic(F: ca.Function, z: NDArray[Any]) -> list[Any]:
    """Write a CasADi function of the operations that poses need in Drake's symbols."""
    symbolic = importlib.import_module("pydrake.symbolic")
    unary = {
        ca.OP_SIN: symbolic.sin, ca.OP_COS: symbolic.cos, ca.OP_NEG: lambda a: -a, ca.OP_SQ: lambda a: a * a,
        ca.OP_TWICE: lambda a: 2 * a, ca.OP_ASSIGN: lambda a: a,
    }  # fmt: skip
    binary = {
        ca.OP_ADD: lambda a, b: a + b, ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b,
        ca.OP_DIV: lambda a, b: a / b,
    }  # fmt: skip
    work: dict[int, Any] = {}
    out: dict[int, Any] = {}
    for k in range(F.n_instructions()):
        operation, given, made = F.instruction_id(k), F.instruction_input(k), F.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[made[0]] = symbolic.Expression(z[given[1]])
        elif operation == ca.OP_OUTPUT:
            out[made[1]] = work[given[0]]
        elif operation == ca.OP_CONST:
            work[made[0]] = symbolic.Expression(F.instruction_constant(k))
        elif operation in unary:
            work[made[0]] = unary[operation](work[given[0]])
        else:
            work[made[0]] = binary[operation](work[given[0]], work[given[1]])
    return [out[i] for i in range(F.numel_out(0))]


def _placement(link: Link) -> tuple[Array, Array]:
    if not isinstance(link, (Base, Series)):
        return np.eye(3), np.zeros(3)
    angles = np.asarray(link.rotation, dtype=float)
    R = np.asarray(ca.DM(po.spatial.rotation_xyz(*angles)))
    return R, np.asarray([*link.at, 0.0][:3], dtype=float)


def _ties(mechanism: po.Mechanism) -> Iterator[tuple[str, Array, str, Array]]:
    for constraint in mechanism.constraints:
        if not isinstance(constraint, Coincidence):
            raise TypeError(f"{type(constraint).__name__} is not written for the peers")
        points = (np.asarray([*p, 0.0][:3], dtype=float) for p in (constraint.point_A, constraint.point_B))
        p_A, p_B = points
        yield constraint.link_A, p_A, constraint.link_B, p_B

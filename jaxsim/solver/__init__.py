"""Convex constraint solver: costs of rows, Newton's method and implicit derivatives."""

from jaxsim.solver.conjugate_gradients import hessian_product, pcg, pcg_solve
from jaxsim.solver.disc import Disc
from jaxsim.solver.elliptic_cone import EllipticCone
from jaxsim.solver.huber import Huber
from jaxsim.solver.implicit import attach, attach_lifted, solve_hessian
from jaxsim.solver.newton import Solution, SolverStatus, solve
from jaxsim.solver.operator import LinearStatus, Operator, weighed
from jaxsim.solver.problem import Kind, Problem
from jaxsim.solver.pyramidal_cone import PyramidalCone
from jaxsim.solver.quadratic import Quadratic
from jaxsim.solver.unilateral import Unilateral

__all__ = [
    "Disc",
    "EllipticCone",
    "Huber",
    "Kind",
    "LinearStatus",
    "Operator",
    "Problem",
    "PyramidalCone",
    "Quadratic",
    "Solution",
    "SolverStatus",
    "Unilateral",
    "attach",
    "attach_lifted",
    "hessian_product",
    "pcg",
    "pcg_solve",
    "solve",
    "solve_hessian",
    "weighed",
]

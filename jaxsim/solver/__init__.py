"""Convex constraint solver: cost kinds, Newton's method, implicit derivatives. No robots here."""

from jaxsim.solver.anywhere import anywhere, in_lanes, place, pushing
from jaxsim.solver.elliptic_cone import EllipticCone
from jaxsim.solver.huber import Huber
from jaxsim.solver.implicit import SOLUTION, attach, attach_lifted
from jaxsim.solver.newton import Solution, SolverStatus, solve
from jaxsim.solver.operator import Operator, weighed
from jaxsim.solver.pcg import hessian_product, pcg, pcg_solve
from jaxsim.solver.problem import Kind, Problem
from jaxsim.solver.pyramidal_cone import PyramidalCone
from jaxsim.solver.quadratic import Quadratic
from jaxsim.solver.unilateral import Unilateral

__all__ = [
    "SOLUTION",
    "EllipticCone",
    "Huber",
    "Kind",
    "Operator",
    "Problem",
    "PyramidalCone",
    "Quadratic",
    "Solution",
    "SolverStatus",
    "Unilateral",
    "anywhere",
    "attach",
    "attach_lifted",
    "hessian_product",
    "in_lanes",
    "pcg",
    "pcg_solve",
    "place",
    "pushing",
    "solve",
    "weighed",
]

"""Trajectory optimisation: one problem, several ways to solve it."""

from jaxsim.trajopt.ddp import DDP
from jaxsim.trajopt.direct import Direct
from jaxsim.trajopt.ilqr import ILQR
from jaxsim.trajopt.inverse_dynamics import InverseDynamics
from jaxsim.trajopt.plan import Iterate, Plan, PlanStatus
from jaxsim.trajopt.predictive_control import Track, mpc, replan
from jaxsim.trajopt.problem import Problem, ProblemError, make_problem
from jaxsim.trajopt.sampling import CEM, MPPI, PredictiveSampling
from jaxsim.trajopt.shooting import Shooting
from jaxsim.trajopt.solving import Method, solve
from jaxsim.trajopt.state_limits import AugmentedLagrangian
from jaxsim.trajopt.transcription.contact_forces import with_contact_forces

__all__ = [
    "CEM",
    "DDP",
    "ILQR",
    "MPPI",
    "AugmentedLagrangian",
    "Direct",
    "InverseDynamics",
    "Iterate",
    "Method",
    "Plan",
    "PlanStatus",
    "PredictiveSampling",
    "Problem",
    "ProblemError",
    "Shooting",
    "Track",
    "make_problem",
    "mpc",
    "replan",
    "solve",
    "with_contact_forces",
]

"""`to_maximal`: from a model to one whose bodies are free and whose joints are rows."""

import mujoco

from jaxsim.dynamics.tendons.inertia import has_tendon_inertia
from jaxsim.io import build, to_mujoco
from jaxsim.maximal.free_bodies import free_bodies
from jaxsim.maximal.maximal import Maximal
from jaxsim.model import Model, ModelError
from jaxsim.model.backward import EXACT
from jaxsim.model.enums import constant_name
from jaxsim.model.errors import expect

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_DIAGEXACT = mujoco.mjtEnableBit.mjENBL_DIAGEXACT
_MATERIAL = "geom_stiffness", "geom_relaxation", "geom_restitution"


def to_maximal(model: Model) -> Maximal:
    """The model in maximal coordinates: every body is free, and its joints are constraint rows.

    It moves as the model does, but for the errors that joints make within a time step, and is
    another way to compute the same: a check of the recursions over the tree, and of closed loops.
    Limits, springs, dampers, dry friction, armature, actuators, tendons and equalities act in joint
    coordinates, with the numbers of the model.

    Args:
      model: a model of one environment, with semi-implicit Euler as its integrator.

    Returns:
      The model in maximal coordinates.

    Raises:
      ModelError: something does not carry over; the message names it.
      TypeError: the model is not a `Model`.
    """
    expect(model, Model, "jaxsim.load")
    _check(model)
    free = build(free_bodies(to_mujoco(model)), model.structure.drops_pairs)
    free = free.replace(
        # Contacts are as soft as those of the model.
        body_invweight0=model.body_invweight0,
        contact=model.contact,
        hessian="auto" if model.hessian == "articulated" else model.hessian,
        max_contacts=model.max_contacts,
        max_geom_pairs=model.max_geom_pairs,
        **{name: getattr(model, name) for name in _MATERIAL},
    )
    return Maximal(bodies=free, tree=model)


def _check(model: Model) -> None:
    problems = []
    if model.opt.integrator != _EULER:
        problems.append(f"integrator {constant_name('mjtIntegrator', model.opt.integrator)!r}")
    if model.opt.noslip_iterations:
        problems.append("noslip_iterations")
    if model.opt.enabled(_DIAGEXACT):
        problems.append("the flag diagexact")
    if len(model.cable_body):
        problems.append("cables")
    if model.flg_adhesion:
        problems.append("adhesion")
    if has_tendon_inertia(model):
        problems.append("armature of tendons")
    if model.nhistory:
        problems.append("delays and intervals")
    if model.backward != EXACT:
        problems.append("backward=...")
    if problems:
        raise ModelError(
            f"maximal coordinates do not carry over {', '.join(problems)}; load the model without"
        )

"""The options of `Model.backward`: which derivatives a constrained acceleration has."""

from typing import TypeVar

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxsim.batching.primitives.jvp_rule import with_jvp_rule
from jaxsim.collision import Contact
from jaxsim.model import Model, ModelError
from jaxsim.model.backward import Backward

T = TypeVar("T")

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


def check_backward(model: Model) -> None:
    """Raises a `ModelError` that names what does not combine with the options of derivatives."""
    if not (model.backward.entry_time or model.backward.smooths):
        return
    if model.contact != "mujoco":
        raise ModelError(f"{model.backward} needs contact='mujoco', not {model.contact!r}")
    if model.flg_adhesion:
        raise ModelError(f"{model.backward} does not combine with adhesion of geoms or pairs")
    if model.backward.entry_time and model.opt.integrator == _RK4:
        raise ModelError("entry_time needs an integrator with one evaluation a step, not RK4")


def softened(contact: Contact, backward: Backward) -> Contact:
    """The contacts whose derivatives are used, with a larger margin and longer time constants.

    The impedance rises from zero at the new margin, and is where it was at penetrations beyond the
    width of `solimp`.
    """
    contact = contact.replace(
        solref=_slower(contact.solref, backward.softening),
        solreffriction=_slower(contact.solreffriction, backward.softening),
    )
    if not backward.distance:
        return contact
    solimp = contact.solimp.at[:, 0].set(0.0).at[:, 2].add(backward.distance)
    return contact.replace(includemargin=contact.includemargin + backward.distance, solimp=solimp)


def _slower(solref: Float[Array, "n 2"], factor: float) -> Float[Array, "n 2"]:
    """`solref` with longer time constants and the same damping ratio, in either format."""
    if factor == 1:
        return solref
    standard = jnp.array([factor, 1.0], solref.dtype)
    direct = jnp.array([factor**-2, 1 / factor], solref.dtype)
    return solref * jax.vmap(lambda time: jnp.where(time > 0, standard, direct))(solref[:, 0])


def with_derivative_of(value: T, other: T) -> T:
    """`value`, with the derivative of `other`, which has the same structure and shapes."""
    leaves, structure = jax.tree.flatten(value)
    return structure.unflatten(_pretend(leaves, jax.tree.leaves(other)))


def _pretend(values: list[Array], others: list[Array]) -> list[Array]:
    n = len(values)

    def rule(primals, tangents):
        return _pretend(list(primals[:n]), list(primals[n:])), list(tangents[n:])

    return list(with_jvp_rule(lambda *xs: list(xs[:n]), rule)(*values, *others))

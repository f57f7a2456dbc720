"""Parameters of a contact, from those of its two geoms or of its explicit pair.

MuJoCo 3.17, chapter "Computation", section "Contact parameters". The margin of a contact is the sum
of its geoms' margins. Below this distance the contact is active, and at it the constraint is not
yet violated. The gap has no effect here: MuJoCo lists contacts between margin and margin + gap, but
they have no force.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.arrays.constants import MINMU, MINVAL
from jaxsim.arrays.indexing import Index, gather


@struct.dataclass
class Surface:
    """The contact parameters of one geom."""

    friction: Float[Array, "3"]
    solref: Float[Array, "2"]
    solimp: Float[Array, "5"]
    solmix: Float[Array, ""]
    priority: Int[Array, ""]


# The leaf of the model for each field of `Surface`.
SURFACE_LEAVES = {f.name: f"geom_{f.name}" for f in dataclasses.fields(Surface)}


@struct.dataclass
class Parameters:
    """The contact parameters of one contact, as in `mjContact`; `gap` is that of `Contact`."""

    includemargin: Float[Array, ""]
    friction: Float[Array, "5"]
    solref: Float[Array, "2"]
    solreffriction: Float[Array, "2"]
    solimp: Float[Array, "5"]
    adhesion: Float[Array, ""] | None = None
    gap: Float[Array, ""] | None = None


def contact_parameters(model: Any, geom1: Index, geom2: Index, pair: Index) -> Parameters:
    """Parameters of contacts between geoms.

    Args:
      model: a `Model`, a `mujoco.MjModel`, or anything with their fields.
      geom1: (n,) first geoms; numpy if static, or traced.
      geom2: (n,) second geoms.
      pair: (n,) explicit pairs, -1 for none.

    Returns:
      Parameters with a leading axis n; differentiable with respect to the model's leaves.
    """
    surfaces = _surfaces(model, geom1), _surfaces(model, geom2)
    friction, solref, solimp = jax.vmap(mix)(*surfaces)
    values = Parameters(
        includemargin=contact_margin(model, geom1, geom2, pair),
        friction=friction[:, np.array([0, 0, 1, 2, 2])],
        solref=solref,
        solreffriction=jnp.zeros_like(solref),
        solimp=solimp,
    )
    values = _with_pairs(model, values, pair)
    if _overridden(model):
        values = _with_override(model, values)
    if model.flg_adhesion:
        values = _with_adhesion(model, values, geom1, geom2, pair)
    return values.replace(friction=jnp.maximum(values.friction, MINMU))


def contact_margin(model: Any, geom1: Index, geom2: Index, pair: Index) -> Float[Array, "n"]:
    """Distance below which contacts are active: sum of the geoms' margins, or the pair's margin."""
    margin = gather(model.geom_margin, geom1) + gather(model.geom_margin, geom2)
    if _overridden(model):
        return jnp.full_like(margin, model.opt.o_margin)
    return _choose(model, pair, model.pair_margin, margin)


def contact_reach(model: Any, geom1: Index, geom2: Index, pair: Index) -> Float[Array, "n"]:
    """Distance below which MuJoCo lists contacts: margin and gap together."""
    return contact_margin(model, geom1, geom2, pair) + _gap(model, geom1, geom2, pair)


def adhesive_reach(model: Any, geom1: Index, geom2: Index, pair: Index) -> Float[Array, "n"]:
    """Distance below which contacts act: the margin, and with adhesion the gap, too."""
    margin = contact_margin(model, geom1, geom2, pair)
    if not model.flg_adhesion:
        return margin
    pulls = _adhesion(model, geom1, geom2, pair) != 0
    return margin + jnp.where(pulls, _gap(model, geom1, geom2, pair), 0.0)


def mix(
    first: Surface, second: Surface
) -> tuple[Float[Array, "3"], Float[Array, "2"], Float[Array, "5"]]:
    """Friction, solref and solimp of two surfaces in contact.

    They are those of the surface of higher priority. At equal priority, friction is the elementwise
    maximum, and solimp and solref are `w first + (1 - w) second` with the weight
    `w = solmix1 / (solmix1 + solmix2)`. If a solref is in the direct format (negative stiffness and
    damping), solref is the elementwise minimum.
    """
    weight = mixing_weight(first.solmix, second.solmix)
    mixed = weight * first.solref + (1 - weight) * second.solref
    standard = (first.solref[0] > 0) & (second.solref[0] > 0)
    solref = jnp.where(standard, mixed, jnp.minimum(first.solref, second.solref))
    solimp = weight * first.solimp + (1 - weight) * second.solimp
    friction = jnp.maximum(first.friction, second.friction)

    def decide(equal, one, two):
        result = jnp.where(first.priority > second.priority, one, equal)
        return jnp.where(first.priority < second.priority, two, result)

    return (
        decide(friction, first.friction, second.friction),
        decide(solref, first.solref, second.solref),
        decide(solimp, first.solimp, second.solimp),
    )


def mixing_weight(solmix1: Float[Array, ""], solmix2: Float[Array, ""]) -> Float[Array, ""]:
    """Weight of the first of two surfaces; with zero solmix it is 0, or 0.5 if both are zero."""
    none1, none2 = solmix1 < MINVAL, solmix2 < MINVAL
    regular = ~none1 & ~none2
    ratio = jnp.where(regular, solmix1, 1.0) / jnp.where(regular, solmix1 + solmix2, 1.0)
    return jnp.where(regular, ratio, jnp.where(none1 & none2, 0.5, jnp.where(none1, 0.0, 1.0)))


def _gap(model: Any, geom1: Index, geom2: Index, pair: Index) -> Float[Array, "n"]:
    gap = gather(model.geom_gap, geom1) + gather(model.geom_gap, geom2)
    return _choose(model, pair, model.pair_gap, gap)


def _adhesion(model: Any, geom1: Index, geom2: Index, pair: Index) -> Float[Array, "n"]:
    """The sum of the geoms' adhesion, that of the geom of higher priority, or the pair's."""
    first, second = (gather(model.geom_adhesion, geom) for geom in (geom1, geom2))
    above = jnp.sign(gather(model.geom_priority, geom1) - gather(model.geom_priority, geom2))
    total = jnp.where(above >= 0, first, 0) + jnp.where(above <= 0, second, 0)
    return _choose(model, pair, model.pair_adhesion, total)


def _with_adhesion(model: Any, values: Parameters, *ids: Index) -> Parameters:
    adhesion = _adhesion(model, *ids)
    return values.replace(adhesion=adhesion, gap=jnp.where(adhesion != 0, _gap(model, *ids), 0.0))


def _surfaces(model: Any, geom: Index) -> Surface:
    return Surface(**{k: gather(getattr(model, leaf), geom) for k, leaf in SURFACE_LEAVES.items()})


def _with_pairs(model: Any, values: Parameters, pair: Index) -> Parameters:
    return values.replace(
        friction=_choose(model, pair, model.pair_friction, values.friction),
        solref=_choose(model, pair, model.pair_solref, values.solref),
        solreffriction=_choose(model, pair, model.pair_solreffriction, values.solreffriction),
        solimp=_choose(model, pair, model.pair_solimp, values.solimp),
    )


def _overridden(model: Any) -> bool:
    return bool(int(model.opt.enableflags) & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE))


def _with_override(model: Any, values: Parameters) -> Parameters:
    """The options `o_*` as the parameters of every contact; `solreffriction` is `o_solref`."""
    return values.replace(
        friction=_for_each_row(model.opt.o_friction, values.friction),
        solref=_for_each_row(model.opt.o_solref, values.solref),
        solreffriction=_for_each_row(model.opt.o_solref, values.solref),
        solimp=_for_each_row(model.opt.o_solimp, values.solimp),
    )


def _for_each_row(value: Float[Array, "k"], like: Float[Array, "n k"]) -> Float[Array, "n k"]:
    return jnp.broadcast_to(jnp.asarray(value, like.dtype)[None], like.shape)


def _choose(model: Any, pair: Index, of_pairs, of_geoms):
    """Rows of `of_pairs` for contacts of explicit pairs, rows of `of_geoms` for all others."""
    explicit = pair >= 0
    if model.npair == 0 or (isinstance(pair, np.ndarray) and not explicit.any()):
        return of_geoms
    chosen = gather(of_pairs, pair.clip(0))
    explicit = jnp.asarray(explicit).reshape((-1,) + (1,) * (of_geoms.ndim - 1))
    return jnp.where(explicit, chosen, of_geoms)

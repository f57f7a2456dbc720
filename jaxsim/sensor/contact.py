"""The contact sensor: data of the contacts between two geoms, bodies or subtrees."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.indexing import Index, gather
from jaxsim.arrays.norms import safe_norm
from jaxsim.model import Model
from jaxsim.sensor.groups import SensorGroup
from jaxsim.sensor.readings import Readings
from jaxsim.sensor.shapes import inside
from jaxsim.spatial import twist_at

_Data, _Object = mujoco.mjtConDataField, mujoco.mjtObj
_SITE = int(_Object.mjOBJ_SITE)
# MuJoCo's reductions of contacts; without any, the first ones are read.
_MINDIST, _MAXFORCE, _NETFORCE = 1, 2, 3


class _Contacts(NamedTuple):
    """Active contacts in MuJoCo's order, in nc slots."""

    there: Bool[Array, "nc"]
    dist: Float[Array, "nc"]
    pos: Float[Array, "nc 3"]
    frame: Float[Array, "nc 3 3"]
    wrench: Float[Array, "nc 6"]
    geom1: Index
    geom2: Index
    body1: Index
    body2: Index


def contact(r: Readings, g: SensorGroup) -> Float[Array, "n dim"]:
    """The quantities in `data` of `num` contacts that match, or of their net force.

    Forces are on the second object, in the contact frame, whose normal points away from the first.
    The selection of contacts has no derivative; the quantities have.
    """
    fields, reduce, num = g.intprm
    found = _in_order(r)
    sign = _matches(r, g, found)
    if not len(found.dist):
        return jnp.zeros((len(g), int(r.model.sensor_dim[g.sensors[0]])), found.dist.dtype)
    if reduce == _NETFORCE:
        return jax.vmap(lambda sign: _net_force(fields, found, sign))(sign)
    values = _data(r, fields, found)
    return jax.vmap(lambda sign: _chosen(fields, reduce, num, found, values, sign))(sign)


def _in_order(r: Readings) -> _Contacts:
    """Contacts ordered by bodies, then by geoms, as in MuJoCo."""
    model, c = r.model, r.signals.contact
    body1, body2 = (gather(model.geom_bodyid, geom) for geom in (c.geom1, c.geom2))
    static = isinstance(body1, np.ndarray) and isinstance(body2, np.ndarray)
    xp = np if static else jnp
    pairs = (c.geom1, c.geom2), (body1, body2)
    keys = [select(*pair) for pair in pairs for select in (xp.maximum, xp.minimum)]
    order = xp.lexsort(keys)
    there = c.active
    parts = there, c.dist, c.pos, c.frame, r.signals.contact_force, c.geom1, c.geom2, body1, body2
    return _Contacts(*(gather(part, order) for part in parts))


def _matches(r: Readings, g: SensorGroup, c: _Contacts) -> Int[Array, "n nc"]:
    """1 if a contact is between the sensor's objects in this order, -1 if in reverse, else 0."""
    first1, first2 = _involved(r.model, g.objtype, g.obj, c)
    second1, second2 = _involved(r.model, g.reftype, g.ref, c)
    regular, reverse = first1 & second2, first2 & second1
    if g.reftype < 0:
        regular, reverse = first1, first2
    elif g.objtype == int(_Object.mjOBJ_UNKNOWN):
        regular, reverse = second2, second1
    sign = jnp.where(regular, 1, jnp.where(reverse, -1, 0))
    if g.objtype == _SITE:
        sign = jnp.where(_inside(r, g, c.pos), sign, 0)
    return jnp.where(c.there[None], sign, 0)


def _involved(model: Model, kind: int, ids: np.ndarray, c: _Contacts):
    """Two (n, nc) masks: whether each object has the first, or second, geom of each contact."""
    if kind == int(_Object.mjOBJ_GEOM):
        return ids[:, None] == c.geom1[None], ids[:, None] == c.geom2[None]
    if kind == int(_Object.mjOBJ_BODY):
        return ids[:, None] == c.body1[None], ids[:, None] == c.body2[None]
    if kind == int(_Object.mjOBJ_XBODY):
        below = _below(model)[ids].T
        return gather(below, c.body1).T, gather(below, c.body2).T
    everything = np.ones((len(ids), len(c.dist)), bool)
    return everything, everything


def _below(model: Model) -> np.ndarray:
    """(nbody, nbody) mask: whether the second body is in the subtree of the first."""
    below = np.eye(model.nbody, dtype=bool)
    for body in range(1, model.nbody):
        below[:, body] |= below[:, model.body_parentid[body]]
    return below


def _inside(r: Readings, g: SensorGroup, points: Float[Array, "nc 3"]) -> Bool[Array, "n nc"]:
    """Whether each contact is in the volume of each sensor's site."""
    model = r.model
    pos, mat = r.frame(_SITE, g.obj)
    rows = []
    for i, site in enumerate(g.obj):
        shape, size = int(model.site_type[site]), model.site_size[site]
        local = (points - pos[i][None]) @ mat[i]
        rows.append(jax.vmap(lambda p, s=shape, size=size: inside(s, size, p))(local))
    return jnp.stack(rows)


def _data(r: Readings, fields: int, c: _Contacts) -> Float[Array, "nc k"]:
    """The data of each contact in its own frame, without the number of contacts found."""
    asked = lambda field: fields >> int(field) & 1  # noqa: E731
    values = {
        _Data.mjCONDATA_FORCE: c.wrench[:, :3],
        _Data.mjCONDATA_TORQUE: c.wrench[:, 3:],
        _Data.mjCONDATA_DIST: c.dist[:, None],
        _Data.mjCONDATA_POS: c.pos,
        _Data.mjCONDATA_NORMAL: c.frame[:, 0],
        _Data.mjCONDATA_TANGENT: c.frame[:, 1],
    }
    if asked(_Data.mjCONDATA_LINVEL) or asked(_Data.mjCONDATA_ANGVEL):
        velocity = _velocity(r, c)
        values[_Data.mjCONDATA_LINVEL] = velocity[:, 3:]
        values[_Data.mjCONDATA_ANGVEL] = velocity[:, :3]
    parts = [value for field, value in values.items() if asked(field)]
    return jnp.concatenate([c.pos[:, :0], *parts], axis=1)


def _velocity(r: Readings, c: _Contacts) -> Float[Array, "nc 6"]:
    """Angular and linear velocity of the second body relative to the first, in the frames."""

    def of(body):
        com = gather(r.motion.kin.subtree_com, gather(r.model.body_rootid, body))
        return jax.vmap(twist_at)(gather(r.cvel, body), c.pos - com)

    relative = (of(c.body2) - of(c.body1)).reshape(-1, 2, 3)
    return jnp.einsum("nij,nkj->nki", c.frame, relative).reshape(-1, 6)


def _reversed(fields: int) -> np.ndarray:
    """Signs of the columns of `_data` for reversed objects: normal and first tangent flip."""
    turned = [1.0, 1.0, -1.0]
    signs = {
        _Data.mjCONDATA_DIST: [1.0],
        _Data.mjCONDATA_POS: [1.0] * 3,
        _Data.mjCONDATA_NORMAL: [-1.0] * 3,
        _Data.mjCONDATA_TANGENT: [-1.0] * 3,
    }
    bits = range(int(_Data.mjCONDATA_FORCE), int(_Data.mjNCONDATA))
    columns = [signs.get(_Data(bit), turned) for bit in bits if fields >> bit & 1]
    return np.array([sign for column in columns for sign in column])


def _chosen(fields: int, reduce: int, num: int, c: _Contacts, values, sign) -> Float[Array, "dim"]:
    """The data of the selected contacts: the first, the closest or the strongest ones."""
    count = jnp.sum(sign != 0)
    order = {_MINDIST: c.dist, _MAXFORCE: -jnp.sum(c.wrench**2, axis=1)}
    score = lax.stop_gradient(order.get(reduce, jnp.arange(len(c.dist), dtype=c.dist.dtype)))
    slots = min(num, len(c.dist))
    _, places = lax.top_k(jnp.where(sign != 0, -score, -jnp.inf), slots)
    flipped = (sign[places] < 0)[:, None]
    rows = values[places] * jnp.where(flipped, jnp.asarray(_reversed(fields))[None], 1)
    if fields >> int(_Data.mjCONDATA_FOUND) & 1:
        rows = jnp.concatenate([jnp.full((slots, 1), count, rows.dtype), rows], axis=1)
    filled = (jnp.arange(slots) < count)[:, None]
    return jnp.pad(jnp.where(filled, rows, 0), ((0, num - slots), (0, 0))).ravel()


def _net_force(fields: int, c: _Contacts, sign) -> Float[Array, "dim"]:
    """Total force and torque of the contacts in world axes, about their force-weighted centroid."""
    wrench = c.wrench * sign[:, None]
    force, torque = (jnp.einsum("nij,ni->nj", c.frame, w) for w in (wrench[:, :3], wrench[:, 3:]))
    weight = jax.vmap(safe_norm)(wrench[:, :3])
    center = weight @ c.pos / jnp.maximum(weight.sum(), MINVAL)
    torque = torque + jnp.cross(c.pos - center[None], force)
    values = {
        _Data.mjCONDATA_FOUND: jnp.sum(sign != 0)[None],
        _Data.mjCONDATA_FORCE: force.sum(0),
        _Data.mjCONDATA_TORQUE: torque.sum(0),
        _Data.mjCONDATA_DIST: np.zeros(1),
        _Data.mjCONDATA_POS: center,
        _Data.mjCONDATA_NORMAL: np.array([1.0, 0, 0]),
        _Data.mjCONDATA_TANGENT: np.array([0, 1.0, 0]),
    }
    asked = [value for field, value in values.items() if fields >> int(field) & 1]
    row = jnp.concatenate([jnp.asarray(value, c.dist.dtype) for value in asked])
    return jnp.where((sign != 0).any(), row, 0)

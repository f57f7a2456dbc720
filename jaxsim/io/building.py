"""`build`: from a compiled `mujoco.MjModel` to a `Model`, with validation of the model."""

import copy
import dataclasses
import hashlib
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.collision.candidates import candidate_pairs
from jaxsim.collision.rays import opaque_geoms
from jaxsim.collision.unsupported import dropped_pairs, unsupported_pairs
from jaxsim.io.actuators import actuator_tables, delay_tables
from jaxsim.io.cables import cable_leaf, cable_tables
from jaxsim.io.fields import field_tables
from jaxsim.io.frames import effective_frames
from jaxsim.io.hulls import flat_meshes, hull_tables
from jaxsim.io.materials import Materials, material_leaves
from jaxsim.io.physical import impossible
from jaxsim.io.pid_controllers import pid_leaf, pid_tables
from jaxsim.io.signed_distances import (
    Functions,
    signed_distances,
    with_functions,
    without_functions,
)
from jaxsim.io.singular import check_mass_matrix
from jaxsim.io.supported import unsupported
from jaxsim.io.touch_grids import grid_tables
from jaxsim.model.model import DELAYS, Model, Option, Statistic
from jaxsim.model.names import Names
from jaxsim.model.problems import raise_problems
from jaxsim.model.structure import ARRAYS, SIZES, Structure

_STATIC_OPTIONS = (
    "integrator cone iterations ls_iterations noslip_iterations "
    "disableflags enableflags disableactuator"
).split()

_STATIC = {f.name for f in dataclasses.fields(Model) if not f.metadata.get("pytree_node", True)}


def build(
    mj: mujoco.MjModel,
    drop_pairs: bool = False,
    materials: Materials | None = None,
    sdf: Functions | None = None,
) -> Model:
    """Validate and convert a compiled model.

    Args:
      mj: a model compiled by MuJoCo.
      drop_pairs: whether pairs of geoms without a collision function pass through each other;
        otherwise they are an error.
      materials: of geoms, by name.
      sdf: signed distance functions of geoms, by name.

    Returns:
      The model, its numbers in JAX's default float type.

    Raises:
      ModelError: the model uses unsupported features, or its physics is impossible.
      ValueError: a material or a function is of no geom, or does not fit.
    """
    source = copy.copy(mj)
    mj = with_functions(mj, sdf or {})
    names = Names.from_mujoco(mj)
    pairs = candidate_pairs(mj)
    raise_problems(
        [
            *unsupported(mj, names.label),
            *([] if drop_pairs else unsupported_pairs(mj, pairs, names.label)),
            *without_functions(mj, pairs, sdf or {}, names.label),
            *impossible(mj, names.label),
            *flat_meshes(mj, names.label),
        ]
    )
    check_mass_matrix(mj, names.label)
    if dropped := dropped_pairs(mj, pairs, names.label):
        warnings.warn(f"these pairs of geoms pass through each other: {dropped}", stacklevel=3)
    delays = delay_tables(mj)
    delayed = any(which.any() for which in delays.values())
    sizes = {name: int(getattr(mj, name)) for name in SIZES}
    structure = Structure(
        sizes=sizes | {"nhistory": mj.nhistory if delayed else 0},
        arrays={
            **{name: _static_array(mj, name) for name in ARRAYS},
            **hull_tables(mj, names.label),
            **field_tables(mj),
            **actuator_tables(mj),
            **grid_tables(mj),
            **cable_tables(mj),
            **pid_tables(mj),
            **delays,
            "wrap_sideid": _side_sites(mj),
            "geom_opaque": opaque_geoms(mj),
            "geom_ellipsoid": mj.geom_fluid[:, 0] > 0,
            "jnt_limits_meet": _narrow(mj.jnt_range, mj.jnt_margin) & _scalar(mj),
            "tendon_limits_meet": _narrow(mj.tendon_range, mj.tendon_margin),
        },
        names=names,
        source=source,
        drops_pairs=drop_pairs,
        meshes=_mesh_digest(mj),
    )
    fields = {f.name for f in dataclasses.fields(Model)} - _STATIC - {"opt", "stat", "sdf"}
    made = material_leaves(mj, materials) | cable_leaf(mj) | pid_leaf(mj)
    fields -= set() if delayed else set(DELAYS)
    leaves = {name: getattr(mj, name) for name in sorted(fields - set(made))}
    leaves |= effective_frames(mj) | made
    model = Model(
        structure=structure,
        opt=_option(mj.opt),
        stat=Statistic(**{n: _leaf(getattr(mj.stat, n)) for n in ("meaninertia", "meanmass")}),
        **{name: _leaf(value) for name, value in leaves.items()},
        sdf=signed_distances(mj, sdf or {}),
    )
    return model.replace(**{name: getattr(model, name) for name in ("opt", *leaves)})


def _leaf(value) -> Any:
    # A copy, because MuJoCo's arrays are views into the model's buffer. NumPy converts it, because
    # JAX would compile a program for each shape.
    return jax.device_put(np.array(value, jnp.result_type(float)))


def _static_array(mj: mujoco.MjModel, name: str) -> np.ndarray:
    value = np.array(getattr(mj, name))
    return value if value.dtype == bool else value.astype(np.int64)


def _side_sites(mj: mujoco.MjModel) -> np.ndarray:
    """(nwrap,) side site of each surface that a tendon wraps around, from `wrap_prm`; -1: none."""
    surface = np.isin(mj.wrap_type, (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER))
    return np.where(surface, np.round(mj.wrap_prm), -1).astype(np.int64)


def _narrow(bounds: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """(n,) which ranges are smaller than both margins, so that both ends may be active."""
    return bounds[:, 1] - bounds[:, 0] < 2 * margin


def _scalar(mj: mujoco.MjModel) -> np.ndarray:
    """(njnt,) which joints have a limit at each end."""
    return np.isin(mj.jnt_type, (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE))


def _mesh_digest(mj: mujoco.MjModel) -> str:
    """Digest of all meshes; rays use those of `Structure.source`, which is not compared itself."""
    parts = mj.geom_dataid, mj.mesh_vertadr, mj.mesh_faceadr, mj.mesh_vert, mj.mesh_face
    return hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in parts)).hexdigest()


def _option(opt) -> Option:
    names = [f.name for f in dataclasses.fields(Option)]
    static = {name: int(getattr(opt, name)) for name in _STATIC_OPTIONS}
    return Option(**static, **{n: _leaf(getattr(opt, n)) for n in names if n not in static})

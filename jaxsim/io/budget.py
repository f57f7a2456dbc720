"""How many slots for contacts a model needs."""

import dataclasses
from collections.abc import Iterator, Sequence

import jax
import mujoco
import numpy as np
from jax import lax
from jaxtyping import Float

from jaxsim.collision import (
    ContactKind,
    PairGroup,
    find_candidates,
    is_movable,
    number_within_reach,
)
from jaxsim.joints import JOINTS
from jaxsim.model import Model

# Up to this many slots, every candidate has its own: selecting some would cost more than it saves.
UNSELECTED_SLOTS = 64
# Probing runs at most PROBES motions of SECONDS each; HEADROOM is the budget's factor over the
# largest number of contacts that occurs.
PROBES, SECONDS, HEADROOM = 8, 2.0, 1.5
# Largest number of time steps times degrees of freedom in all motions; about 1 s of MuJoCo C.
WORK = 1_000_000
# Controls are held constant for these times in turn (s); 0 means one time step.
HELD = 0.1, 0.0, 0.5
MAX_CONDIM = 6
# A motion that is faster than this has diverged (m/s or rad/s).
DIVERGED = 1e4
# Number of poses at which the pairs are counted whose bounding volumes overlap.
POSES = 128
# Budgets are rounded up to a multiple of GRAIN and are at least MIN_BUDGET.
GRAIN, MIN_BUDGET = 4, 8
# Pairs are selected only if there are more than this factor times the budget: below it, selecting
# costs more than the exact geometry of the other pairs.
SELECTION_FACTOR = 4

Limit = int | tuple[int, ...] | None
Budget = tuple[Limit, Limit]


def contact_budget(
    mj: mujoco.MjModel, model: Model, max_geom_pairs: int | None, max_contacts: int | None
) -> Budget:
    """Limits on geom pairs (for each pair of shapes) and contact slots (for each kind of contact).

    Args:
      mj: the compiled model.
      model: the `Model` built from it.
      max_geom_pairs: the user's choice, or None.
      max_contacts: the user's choice, or None.

    Returns:
      `max_geom_pairs` and `max_contacts`; None where every candidate has its own slots.

    Raises:
      ModelError: geoms of unsupported shapes may collide, or a limit is not positive.
    """
    candidates = find_candidates(model, max_geom_pairs, max_contacts)
    if candidates.ncon <= UNSELECTED_SLOTS or (max_geom_pairs and max_contacts):
        return max_geom_pairs, max_contacts
    seen = probe(mj, list(candidates.by_kind()))
    slots = tuple(_rounded(count) for count in seen.contacts)
    return max_geom_pairs or _pair_limits(model, candidates.groups, seen), max_contacts or slots


def _pair_limits(model: Model, groups: Sequence[PairGroup], seen: "Seen") -> tuple[int, ...] | None:
    """Limit on the pairs of each group; None if no group is so large that selecting pays."""
    # More pairs have overlapping bounding volumes than are in contact.
    pairs = _rounded(2 * seen.pairs)
    crowded = [len(group) > SELECTION_FACTOR * pairs for group in groups]
    if not any(crowded):
        return None
    near = [_most_near(model, g, seen) if c else 0 for g, c in zip(groups, crowded, strict=True)]
    return tuple(max(pairs, _rounded(number)) for number in near)


def _most_near(model: Model, group: PairGroup, seen: "Seen") -> int:
    """Largest number of a group's pairs whose bounding volumes overlap, at the poses seen."""

    @jax.jit
    def most(xpos, xmat):
        return lax.map(lambda pose: number_within_reach(model, group, *pose), (xpos, xmat)).max()

    return int(most(seen.geom_xpos, seen.geom_xmat))


@dataclasses.dataclass
class Seen:
    """What occurs in random motions.

    Attributes:
      pairs: largest number of pairs in contact.
      contacts: largest number of contacts of each kind.
      geom_xpos, geom_xmat: poses of the geoms at some times.
    """

    pairs: int
    contacts: list[int]
    geom_xpos: Float[np.ndarray, "t ngeom 3"]
    geom_xmat: Float[np.ndarray, "t ngeom 3 3"]


def probe(mj: mujoco.MjModel, kinds: list[ContactKind]) -> Seen:
    """Simulate random motions.

    MuJoCo simulates the model under random controls. Half of the motions begin at the reference
    pose or a keyframe, the others at random angles of joints and of free bodies.
    """
    steps = int(SECONDS / mj.opt.timestep)
    probes = min(PROBES, max(1, WORK // (mj.nv * steps)))
    steps = min(steps, WORK // mj.nv)
    movable = is_movable(mj, np.arange(mj.ngeom))
    pairs, contacts = 0, np.zeros(4 * MAX_CONDIM + 4, int)
    xpos, xmat = [], []
    every = -(-probes * steps // POSES)
    for k in range(probes):
        for step, data in enumerate(_motion(mj, k, steps)):
            if step % every == 0:
                xpos.append(data.geom_xpos.copy())
                xmat.append(data.geom_xmat.reshape(-1, 3, 3).copy())
            geoms = data.contact.geom
            if data.ncon > pairs:
                pairs = max(pairs, len(np.unique(geoms @ [mj.ngeom, 1])))
            code = 4 * data.contact.dim + movable[geoms] @ [2, 1]
            contacts = np.maximum(contacts, np.bincount(code, minlength=len(contacts)))
    code = [4 * kind.condim + 2 * kind.movable[0] + kind.movable[1] for kind in kinds]
    return Seen(pairs, contacts[code].tolist(), np.stack(xpos), np.stack(xmat))


def _motion(mj: mujoco.MjModel, number: int, steps: int) -> Iterator[mujoco.MjData]:
    """Simulate one random motion and yield the data after each step, until it diverges."""
    rng = np.random.default_rng(number)
    data = mujoco.MjData(mj)
    if number < mj.nkey:
        mujoco.mj_resetDataKeyframe(mj, data, number)
    elif number % 2:
        data.qpos[:] = _random_pose(mj, rng)
    data.qvel[:] = 0.1 * rng.normal(size=mj.nv)
    hold = max(1, round(HELD[number % len(HELD)] / mj.opt.timestep))
    for k in range(steps):
        if k % hold == 0:
            data.ctrl[:] = rng.uniform(*_control_range(mj))
        mujoco.mj_step(mj, data)
        yield data
        if not np.abs(data.qvel).max() < DIVERGED:
            return


def _random_pose(mj: mujoco.MjModel, rng: np.random.Generator) -> np.ndarray:
    """Random positions of limited scalar joints, random orientations of ball and free joints."""
    qpos = mj.qpos0.copy()
    for joint in range(mj.njnt):
        at, kind = mj.jnt_qposadr[joint], JOINTS[int(mj.jnt_type[joint])]
        if kind.nq == 1 and mj.jnt_limited[joint]:
            qpos[at] = rng.uniform(*mj.jnt_range[joint])
        elif kind.nq > 1:
            rotation = rng.normal(size=4)
            qpos[at + kind.nq - 4 : at + kind.nq] = rotation / np.linalg.norm(rotation)
    return qpos


def _control_range(mj: mujoco.MjModel):
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -1.0)
    return low, np.where(limited, mj.actuator_ctrlrange[:, 1], 1.0)


def _rounded(count: int) -> int:
    return max(MIN_BUDGET, int(np.ceil(HEADROOM * count / GRAIN) * GRAIN))

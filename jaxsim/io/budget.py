"""How many contacts a model needs slots for."""

import collections

import mujoco
import numpy as np

from jaxsim.collision import ContactKind, find_candidates, is_movable
from jaxsim.model import Model

# Up to this many slots, every candidate keeps its own: sorting would cost more than it saves.
FEW_SLOTS = 64
# Probing: this many states are simulated for this long; the budget is this much above what occurs.
PROBES, PROBE_STEPS, HEADROOM = 8, 200, 1.5
# Budgets are rounded up to multiples of a grain, and are not smaller than a few.
GRAIN, FEW = 4, 8
# Choosing pairs costs as much as the exact geometry of so many times their number.
CHOICE = 4

Budget = tuple[int | None, int | tuple[int, ...] | None]


def contact_budget(
    mj: mujoco.MjModel, model: Model, max_geom_pairs: int | None, max_contacts: int | None
) -> Budget:
    """Limits on exact geom pairs (per pair of shapes) and contact slots (per kind of contact).

    Args:
      mj: the compiled model.
      model: the same.
      max_geom_pairs: the user's choice, or None.
      max_contacts: the user's choice, or None.

    Returns:
      Both limits; None where every candidate gets its own slots.

    Raises:
      ModelError: geoms of unsupported shapes may collide, or a limit is not positive.
    """
    candidates = find_candidates(model, max_geom_pairs, max_contacts)
    if candidates.ncon <= FEW_SLOTS or (max_geom_pairs and max_contacts):
        return max_geom_pairs, max_contacts
    pairs, contacts = probe(mj, list(candidates.by_kind()))
    # Bounding volumes let through more pairs than touch.
    pairs = _rounded(2 * pairs)
    crowded = max(len(group) for group in candidates.groups) > CHOICE * pairs
    slots = tuple(_rounded(count) for count in contacts)
    return max_geom_pairs or (pairs if crowded else None), max_contacts or slots


def probe(mj: mujoco.MjModel, kinds: list[ContactKind]) -> tuple[int, list[int]]:
    """Largest numbers of pairs in contact, and of contacts of each kind, in random motion.

    MuJoCo simulates the model from its reference pose and its keyframes under random controls.
    """
    rng = np.random.default_rng(0)
    data = mujoco.MjData(mj)
    pairs, contacts = 0, dict.fromkeys(kinds, 0)
    for k in range(PROBES):
        mujoco.mj_resetData(mj, data)
        if k < mj.nkey:
            mujoco.mj_resetDataKeyframe(mj, data, k)
        data.qvel[:] = 0.1 * rng.normal(size=mj.nv)
        for _ in range(PROBE_STEPS):
            data.ctrl[:] = rng.uniform(*_control_range(mj))
            mujoco.mj_step(mj, data)
            geoms = data.contact.geom
            pairs = max(pairs, len(np.unique(geoms, axis=0)))
            sides = zip(data.contact.dim.tolist(), is_movable(mj, geoms).tolist(), strict=True)
            seen = collections.Counter(ContactKind(dim, (a, b)) for dim, (a, b) in sides)
            contacts = {kind: max(count, seen[kind]) for kind, count in contacts.items()}
    return pairs, list(contacts.values())


def _control_range(mj: mujoco.MjModel):
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -1.0)
    return low, np.where(limited, mj.actuator_ctrlrange[:, 1], 1.0)


def _rounded(count: int) -> int:
    return max(FEW, int(np.ceil(HEADROOM * count / GRAIN) * GRAIN))

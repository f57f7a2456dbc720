"""How many contacts a model needs slots for."""

import mujoco
import numpy as np

from jaxsim.collision import find_candidates
from jaxsim.model import Model

# Up to this many slots, every candidate keeps its own: sorting would cost more than it saves.
FEW_SLOTS = 64
# Probing: this many states are simulated for this long; the budget is this much above what occurs.
PROBES, PROBE_STEPS, HEADROOM = 8, 200, 1.5
# Slots and pairs are rounded up to multiples of this.
GRAIN = 8


def contact_budget(
    mj: mujoco.MjModel, model: Model, max_geom_pairs: int | None, max_contacts: int | None
) -> tuple[int | None, int | None]:
    """Limits on exact geom pairs (per pair of shapes) and contact slots (per condim).

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
    pairs, contacts = probe(mj)
    return max_geom_pairs or _rounded(pairs), max_contacts or _rounded(contacts)


def probe(mj: mujoco.MjModel) -> tuple[int, int]:
    """Largest numbers of close geom pairs and of contacts while the model moves at random.

    MuJoCo simulates it from its reference pose and its keyframes under random controls.
    """
    rng = np.random.default_rng(0)
    data = mujoco.MjData(mj)
    pairs = contacts = 1
    for k in range(PROBES):
        mujoco.mj_resetData(mj, data)
        if k < mj.nkey:
            mujoco.mj_resetDataKeyframe(mj, data, k)
        data.qvel[:] = 0.1 * rng.normal(size=mj.nv)
        for _ in range(PROBE_STEPS):
            data.ctrl[:] = rng.uniform(*_control_range(mj))
            mujoco.mj_step(mj, data)
            contacts = max(contacts, data.ncon)
            pairs = max(pairs, len({tuple(g) for g in data.contact.geom}))
    # Bounding volumes let through more pairs than touch.
    return 2 * pairs, contacts


def _control_range(mj: mujoco.MjModel):
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -1.0)
    return low, np.where(limited, mj.actuator_ctrlrange[:, 1], 1.0)


def _rounded(count: int) -> int:
    return int(np.ceil(HEADROOM * count / GRAIN) * GRAIN)

"""Height fields as arrays, padded to equal size."""

import mujoco
import numpy as np

_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)


def field_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe its height fields.

    Args:
      mj: a compiled model.

    Returns:
      `geom_field` (ngeom,): height field of each geom, -1 for other shapes. `field_height`
      (n, r, c): heights (m), padded at the ends of rows and columns. `field_count` (n, 2): numbers
      of rows and columns. `field_size` (n, 4): MuJoCo's `hfield_size`. `geom_reach` (ngeom,):
      radius of each geom's bounding sphere (m), zero if the model has no height field.
    """
    geom_field = np.where(mj.geom_type == _HFIELD, mj.geom_dataid, -1)
    count = np.stack([mj.hfield_nrow, mj.hfield_ncol], axis=1).astype(int)
    height = np.zeros((mj.nhfield, *count.max(axis=0, initial=0)))
    for k, (rows, columns) in enumerate(count):
        start = mj.hfield_adr[k]
        data = mj.hfield_data[start : start + rows * columns].reshape(rows, columns)
        height[k, :rows, :columns] = data * mj.hfield_size[k, 2]
    used = bool((geom_field >= 0).any())
    return {
        "geom_field": geom_field,
        "field_height": height,
        "field_count": count,
        "field_size": np.array(mj.hfield_size),
        "geom_reach": np.array(mj.geom_rbound) * used,
    }

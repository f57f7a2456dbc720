"""`forward` and MuJoCo at the same states: constraints of all kinds, both cones."""

import numpy as np
import pytest
from instants import DOUBLE, SINGLE, assert_instants, converging, forward_all, rollout
from scenes import SCENES

from jaxsim.io import load

# Which scenes have contacts that the cone matters for.
CASES = [(name, "pyramidal") for name in SCENES] + [("floor", "elliptic"), ("pile", "elliptic")]


@pytest.mark.parametrize(("scene", "cone"), CASES)
def test_small_scenes(scene, cone):
    mj = converging(SCENES[scene], cone)
    datas = rollout(mj, 12, 15, seed=1, spread=0.5)
    assert np.mean([d.nefc for d in datas]) > 3
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)

"""What `print(model)` says."""

import jax
import jax.numpy as jnp

import jaxsim


def test_a_model_is_printed_in_about_ten_lines(bundled):
    text = str(jaxsim.load(bundled("humanoid")))
    assert 5 < len(text.splitlines()) < 13
    assert max(map(len, text.splitlines())) <= 100
    for told in ("nv 23", "13: torso", "17: abdomen_y", "0.003 s", "rk4", "..."):
        assert told in text


def test_numbers_of_batches_and_tracers_are_no_trouble(bundled):
    model = jaxsim.load(bundled("pendulum"))
    told = []
    jax.make_jaxpr(lambda m: told.append(str(m)) or jnp.zeros(()))(model)
    told.append(str(jax.tree.map(lambda x: jnp.stack([x, x]), model)))
    assert "timestep (float32[]) s" in told[0]
    assert "timestep (float32[2]) s" in told[1]

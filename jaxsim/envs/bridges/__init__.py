"""Environments for other libraries: Gymnasium, Stable-Baselines3, Brax, torch.

Gymnasium's environments are made by `gymnasium.make` and `gymnasium.make_vec`; the adapters for
the other libraries are in the modules `brax_env`, `stable_baselines` and `torch_env`.
"""

from jaxsim.envs.bridges.registration import gymnasium_id, register_gymnasium

__all__ = ["gymnasium_id", "register_gymnasium"]

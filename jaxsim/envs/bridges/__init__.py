"""Environments for other libraries: Gymnasium, Stable-Baselines3, Brax, torch."""

from jaxsim.envs.bridges.registration import gymnasium_id, register_gymnasium

__all__ = ["gymnasium_id", "register_gymnasium"]

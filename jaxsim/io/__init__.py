"""Reading models from files, strings and MuJoCo's own objects."""

from jaxsim.io.load import bundled_models, load

__all__ = ["bundled_models", "load"]

"""Whether time steps become kernels: one setting for the process."""

_enabled = False


def enable_lanes(on: bool) -> None:
    """Turn kernels on or off for programs that are traced from now on."""
    global _enabled
    _enabled = on


def lanes_enabled() -> bool:
    """Whether time steps become kernels."""
    return _enabled

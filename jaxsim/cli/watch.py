"""`jaxsim train --watch`: the present policy in the browser while it learns."""

import threading
from typing import Any

import jax
import jax.numpy as jnp

from jaxsim.cli.report import note
from jaxsim.viz import live


class Watch:
    """Shows the policy of the last epoch; called with each new one."""

    def __init__(self, env: Any, host: str = "127.0.0.1", port: int = 8080):
        """Remember what it acts in, and where the page will be."""
        self._env, self._address = env, {"host": host, "port": port}
        self._played: live.Played | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)

    def __call__(self, policy: Any) -> None:
        """Show this policy from now on; the first one opens the page."""
        policy = jax.tree.map(jnp.asarray, jax.device_get(policy))  # on one device
        if self._played is not None:
            self._played.policy = policy
            return
        self._played = live.Played(self._env, policy)
        self._thread.start()

    def close(self) -> None:
        """End the page, and wait until it has: a step that runs while Python ends aborts it."""
        self._ended.set()
        if self._played is not None:
            self._thread.join()

    def _show(self) -> None:
        assert self._played is not None
        try:
            live.in_browser(
                self._played,
                **self._address,
                title="jaxsim train",
                ready=lambda url: note(f"the present policy is at {url}"),
                until=self._ended.is_set,
            )
        except RuntimeError as error:
            note(f"no page: {error}")

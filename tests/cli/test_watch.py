"""`jaxsim train --watch`: the page ends before the process does, which would abort otherwise."""

import threading
import urllib.request

import jax
import jax.numpy as jnp
import pytest

from jaxsim import envs
from jaxsim.cli import watch

pytest.importorskip("viser")


def test_closing_ends_the_page_and_its_thread(monkeypatch):
    address, opened = [], threading.Event()
    monkeypatch.setattr(watch, "note", lambda text: (address.append(text), opened.set()))
    page = watch.Watch(envs.make("fast"), port=8790)
    page.close()  # nothing was shown yet
    page = watch.Watch(envs.make("fast"), port=8790)
    for action in (0.1, 0.2):
        page(jax.tree_util.Partial(lambda a, obs: a * jnp.ones(1), jnp.asarray(action)))
    assert opened.wait(60)
    url = address[0].rsplit(" ", 1)[-1]
    assert urllib.request.urlopen(url, timeout=10).status == 200
    page.close()
    assert not page._thread.is_alive()

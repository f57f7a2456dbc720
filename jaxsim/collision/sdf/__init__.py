"""Contacts of shapes that are given by signed distance functions of the user.

`body` has the distances to all other shapes, `descent` finds the deepest points of one shape
in the other, and `pair` makes them contacts.
"""

from jaxsim.collision.sdf.pair import MAX_CONTACTS, sdf_pair
from jaxsim.collision.sdf.signed_distance import SignedDistance, SignedDistances

__all__ = ["MAX_CONTACTS", "SignedDistance", "SignedDistances", "sdf_pair"]

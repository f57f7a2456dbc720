"""Collision detection: shapes, pair functions, candidate pairs and contact parameters."""

from jaxsim.collision.candidates import (
    Candidates,
    PairGroup,
    find_candidates,
    is_movable,
    model_candidates,
)
from jaxsim.collision.contact import Contact, ContactKind, SlotRange
from jaxsim.collision.detection import detect, number_within_reach
from jaxsim.collision.parameters import contact_parameters
from jaxsim.collision.shapes import INACTIVE, Contacts, Hull, HullFaces, Shape
from jaxsim.collision.table import PAIRS, PairFunction

__all__ = [
    "INACTIVE",
    "PAIRS",
    "Candidates",
    "Contact",
    "ContactKind",
    "Contacts",
    "Hull",
    "HullFaces",
    "PairFunction",
    "PairGroup",
    "Shape",
    "SlotRange",
    "contact_parameters",
    "detect",
    "find_candidates",
    "is_movable",
    "model_candidates",
    "number_within_reach",
]

"""The static filters: by rule on small models, and against MuJoCo on every model at hand."""

import importlib.util
from pathlib import Path

import jax
import mujoco
import numpy as np
import pytest

from jaxsim.collision import find_candidates
from jaxsim.collision.candidates import candidate_pairs
from jaxsim.collision.table import BOX, CYLINDER, PAIRS, PLANE, SPHERE
from jaxsim.model.errors import ModelError

FOLDERS = {
    "gymnasium": "envs/mujoco/assets",
    "brax": "envs/assets",
    "mujoco": "mjx/test_data",
}


def model_files():
    """MJCF files of the installed packages; some of these packages are optional."""
    files = []
    for package, folder in FOLDERS.items():
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.submodule_search_locations:
            files += sorted(Path(spec.submodule_search_locations[0], folder).glob("**/*.xml"))
    return files


def pairs(xml: str) -> set[tuple[int, int]]:
    """Candidate pairs of a model given the inside of its worldbody."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    return {(int(a), int(b)) for a, b, _ in candidate_pairs(model)}


CHAIN = """<worldbody><geom type="plane" size="1 1 1"/>
  <body name="a"><freejoint/><geom size=".1"/>
    <body name="b"><geom size=".1"/>
      <body name="c"><joint/><geom size=".1"/></body></body></body></worldbody>"""


def test_welded_bodies_and_parents_do_not_collide():
    # b is welded to a, so c is a child of a too; the world is nobody's parent.
    assert pairs(CHAIN) == {(0, 1), (0, 2), (0, 3)}


def test_parents_collide_without_the_filter():
    flag = '<option><flag filterparent="disable"/></option>'
    assert pairs(flag + CHAIN) == {(0, 1), (0, 2), (0, 3), (1, 3), (2, 3)}


def test_excluded_bodies_do_not_collide():
    flag = '<option><flag filterparent="disable"/></option>'
    exclude = '<contact><exclude body1="c" body2="a"/></contact>'
    assert pairs(flag + CHAIN + exclude) == {(0, 1), (0, 2), (0, 3), (2, 3)}


def test_immovable_bodies_do_not_collide():
    scene = """<worldbody><geom size=".1"/><body><geom size=".1"/></body>
      <body mocap="true"><geom size=".1"/></body><body mocap="true"><geom size=".1"/></body>
      <body><freejoint/><geom size=".1"/></body></worldbody>"""
    assert pairs(scene) == {(0, 4), (1, 4), (2, 4), (3, 4)}


@pytest.mark.parametrize(
    ("masks", "collide"),
    [((1, 0, 0, 1), True), ((1, 0, 1, 0), False), ((2, 4, 4, 1), True), ((2, 1, 4, 1), False)],
)
def test_masks(masks, collide):
    contype1, conaffinity1, contype2, conaffinity2 = masks
    scene = f"""<worldbody>
      <geom size=".1" contype="{contype1}" conaffinity="{conaffinity1}"/><body><freejoint/>
      <geom size=".1" contype="{contype2}" conaffinity="{conaffinity2}"/></body></worldbody>"""
    assert pairs(scene) == ({(0, 1)} if collide else set())


def test_lower_type_comes_first():
    scene = """<worldbody><geom type="capsule" size=".1 .1"/><geom type="plane" size="1 1 1"/>
      <body><freejoint/><geom size=".1"/><geom type="box" size=".1 .1 .1"/></body></worldbody>"""
    assert pairs(scene) == {(2, 0), (0, 3), (1, 2), (1, 3)}


def test_explicit_pairs_bypass_masks_and_excludes_and_replace_the_dynamic_pair():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body name="a"><freejoint/><geom name="a" size=".1"/>
        <geom name="a2" size=".1" contype="0" conaffinity="0"/></body>
      <body name="b"><freejoint/><geom name="b" type="capsule" size=".1 .1"/></body></worldbody>
      <contact><exclude body1="a" body2="b"/>
        <pair geom1="b" geom2="a2" condim="1"/><pair geom1="a" geom2="b" condim="6"/>
        <pair geom1="a" geom2="a2"/></contact></mujoco>""")
    groups = find_candidates(model).groups
    assert [(g.kind.condim, g.geom1.tolist(), g.geom2.tolist()) for g in groups] == [
        (1, [1], [2]),
        (6, [0], [2]),
    ]
    for group in groups:
        assert model.pair_dim[group.pair[0]] == group.kind.condim


def test_condim_follows_priority_and_then_the_larger_one():
    scene = """<mujoco><worldbody><geom size=".1" condim="1" priority="{}"/><body><freejoint/>
      <geom size=".1" condim="4"/></body></worldbody></mujoco>"""
    for priority, condim in ((0, 4), (1, 1), (-1, 4)):
        model = mujoco.MjModel.from_xml_string(scene.format(priority))
        assert [g.kind.condim for g in find_candidates(model).groups] == [condim]


def test_disabled_contacts_leave_no_candidates():
    for flag in ("contact", "constraint"):
        assert pairs(f'<option><flag {flag}="disable"/></option>{CHAIN}') == set()


def test_unsupported_shapes_are_named(monkeypatch):
    monkeypatch.delitem(PAIRS, (CYLINDER, BOX))
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom name="table" type="box" size=".1 .1 .1"/>
      <body><freejoint/><geom type="cylinder" size=".1 .1"/></body></worldbody></mujoco>""")
    message = (
        "geom number 1 of body number 1 and geom 'table': cylinder and box .*plane-sphere.*<ex"
    )
    with pytest.raises(ModelError, match=message):
        find_candidates(model)


PAIR = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" {masks}/>
  <body name="b"><freejoint/><geom name="ball" size=".1" {masks}/></body></worldbody>
  <contact>{contact}</contact></mujoco>"""


def test_the_remedy_for_an_explicit_pair_is_to_remove_it(monkeypatch):
    """No mask and no <exclude> keeps it from colliding."""
    monkeypatch.delitem(PAIRS, (PLANE, SPHERE))
    none = 'contype="0" conaffinity="0"'
    pair, exclude = '<pair geom1="floor" geom2="ball"/>', '<exclude body1="world" body2="b"/>'
    explicit = mujoco.MjModel.from_xml_string(PAIR.format(masks=none, contact=pair + exclude))
    with pytest.raises(ModelError, match="'floor' and geom 'ball'.*; remove their <pair>$"):
        find_candidates(explicit)
    for masks, contact in ((none, ""), ("", exclude)):
        find_candidates(mujoco.MjModel.from_xml_string(PAIR.format(masks=masks, contact=contact)))
    with pytest.raises(ModelError, match="set contype"):
        find_candidates(mujoco.MjModel.from_xml_string(PAIR.format(masks="", contact="")))


@pytest.mark.parametrize("limits", [{"max_geom_pairs": 0}, {"max_contacts": -1}])
def test_limits_must_be_positive(limits):
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{CHAIN}</mujoco>")
    with pytest.raises(ModelError, match=next(iter(limits))):
        find_candidates(model, **limits)


def test_slots_are_counted_by_kind_and_budget():
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom type="plane" size="1 1 1"/>
      <body><freejoint/><geom type="capsule" size=".1 .1" condim="1"/></body>
      <body><freejoint/><geom type="capsule" size=".1 .1" condim="6"/></body>
      <body><freejoint/><geom size=".1"/></body></worldbody></mujoco>""")
    # plane-capsule 2, plane-sphere 1, sphere-capsule 1, capsule-capsule 2 slots
    every = find_candidates(model)
    sizes = {tuple(b.kind): b.stop - b.start for b in every.ranges}
    ground, moving = (False, True), (True, True)
    assert sizes == {(3, ground): 2 + 1, (3, moving): 1, (6, ground): 2, (6, moving): 1 + 2}
    assert (every.ncon, every.dynamic) == (9, False)
    few = find_candidates(model, max_geom_pairs=1, max_contacts=2)
    assert [(b.start, b.stop) for b in few.ranges] == [(0, 2), (2, 3), (3, 5), (5, 7)]
    assert few.dynamic
    some = find_candidates(model, max_contacts=(1, 5, 2, 1))
    assert [(b.start, b.stop) for b in some.ranges] == [(0, 1), (1, 2), (2, 4), (4, 5)]
    assert not find_candidates(model, max_geom_pairs=2, max_contacts=5).dynamic


@pytest.mark.parametrize("path", model_files(), ids=lambda p: f"{p.parts[-2]}-{p.stem}")
def test_no_contact_of_mujoco_is_missing(path, rng):
    """Every contact that can act on something is between candidates, with the same condim."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    rows = {(int(a), int(b)) for a, b, _ in candidate_pairs(model)}
    reachable = set()
    for _ in range(20 if model.nv < 100 else 3):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.6)
        mujoco.mj_fwdPosition(model, data)
        reachable |= {tuple(c.geom.tolist()) for c in data.contact if c.exclude != 3}
    assert reachable <= rows


def random_tree(rng) -> mujoco.MjModel:
    """Bodies that all overlap, with random joints, masks, exclusions and explicit pairs."""
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody]
    for i in range(9):
        parent = bodies[rng.integers(len(bodies))]
        body = parent.add_body(name=f"b{i}", pos=0.1 * rng.normal(size=3))
        if parent is spec.worldbody and rng.random() < 0.2:
            body.mocap = True
        elif rng.random() < 0.6:
            body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
        for j in range(2):
            mask = {"contype": rng.integers(4), "conaffinity": rng.integers(4)}
            body.add_geom(name=f"g{i}{j}", size=[5, 0, 0], **mask)
        bodies.append(body)
    for i, j in rng.integers(9, size=(3, 2)):
        if i != j:
            spec.add_exclude(bodyname1=f"b{i}", bodyname2=f"b{j}")
    spec.add_pair(geomname1="g00", geomname2="g81")
    spec.add_pair(geomname1="g71", geomname2="g20")
    return spec.compile()


@pytest.mark.parametrize("seed", range(20))
def test_candidates_are_exactly_what_mujoco_collides(seed):
    model = random_tree(np.random.default_rng(seed))
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    touching = {tuple(sorted(c.geom.tolist())) for c in data.contact if c.exclude != 3}
    rows = candidate_pairs(model)
    assert {tuple(sorted((int(a), int(b)))) for a, b, _ in rows} == touching
    assert len(rows) == len(touching)


def test_order_is_deterministic_and_ids_are_numpy():
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{CHAIN}</mujoco>")
    first, second = find_candidates(model), find_candidates(model)
    for one, two in zip(first.groups, second.groups, strict=True):
        for name in ("geom1", "geom2", "pair"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
            assert not isinstance(getattr(one, name), jax.Array)

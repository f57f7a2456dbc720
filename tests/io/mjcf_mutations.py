"""Random damage to MJCF: other numbers, other attributes, other elements, other characters."""

import copy
import random
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
EDGES = "0 -0 -1 1 2 1e-320 1e-8 1e8 -1e8 1e39 1e308 nan inf -inf 2147483648 4294967297".split()
WORDS = (
    "true false auto enable disable hinge slide ball free sphere capsule box plane cylinder "
    "ellipsoid mesh hfield sdf Euler RK4 implicit implicitfast pyramidal elliptic Newton CG PGS "
    "none filter filterexact integrator muscle user fixed affine world radian degree XYZ nosuch"
).split()
# New attributes and new elements by the element that gets them, one a line.
ATTRIBUTES = {
    "joint": """
        frictionloss=.1
        stiffness=3
        armature=.1
        damping=1
        springdamper='1 1'
        ref=1
        springref=1
        margin=.01
        limited=true
        range='-1 1'
        solreflimit='-10 -1'
        actuatorfrcrange='-1 1'
        group=9
        actuatorgravcomp=true
    """,
    "geom": """
        mass=0
        density=0
        friction='0 0 0'
        condim=6
        margin=.1
        gap=.05
        solref='.1 2'
        solmix=0
        solimp='.5 .9 .1 .5 2'
        priority=3
        contype=0
        fluidshape=ellipsoid
        pos='9 9 9'
        quat='0 0 0 0'
        size='.1 .1 .1'
        fromto='0 0 0 0 0 1'
        euler='1 2 3'
        shellinertia=true
        adhesion=1
    """,
    "body": """
        gravcomp=1
        mocap=true
        pos='1 1 1'
        quat='1 1 0 0'
        childclass=none
        sleep=never
    """,
    "option": """
        timestep=1e-4
        density=1000
        viscosity=1
        wind='1 2 3'
        integrator=RK4
        cone=elliptic
        impratio=10
        noslip_iterations=2
        o_margin=1
        gravity='0 0 nan'
        jacobian=sparse
    """,
    "compiler": """
        angle=radian
        autolimits=false
        inertiafromgeom=false
        boundmass=1
        balanceinertia=true
        settotalmass=3
        fusestatic=true
        eulerseq=zyx
        inertiagrouprange='1 2'
        alignfree=true
    """,
    "motor": """
        gear='0 0 0 0 0 0'
        ctrlrange='1 -1'
        forcerange='-1 1'
        delay=.1
        nsample=3
        armature=2
    """,
}
ELEMENTS = {
    "worldbody": """
        <light/>
        <camera/>
        <site/>
        <frame/>
        <geom size='.1'/>
        <geom type='mesh'/>
        <body><freejoint/></body>
        <body><joint/><geom size='.1'/></body>
        <body mocap='true'/>
        <body><freejoint/><geom type='cylinder' size='.1 .2'/></body>
        <geom type='plane' size='0 0 1'/>
        <body><freejoint/><geom type='ellipsoid' size='.1 .2 .3'/></body>
        <body><freejoint/><geom type='box' size='.1 .1 0'/></body>
        <geom type='hfield' hfield='hills'/>
        <body><composite type='cable' count='3 1 1' size='1'/></body>
        <attach model='none'/>
        <replicate count='3' offset='1 0 0'><geom size='.1'/></replicate>
    """,
    "body": """
        <joint/>
        <freejoint/>
        <geom size='.1'/>
        <inertial pos='0 0 0' mass='1'/>
        <site/>
        <body/>
        <inertial pos='0 0 0' mass='1' diaginertia='1 1 9'/>
        <joint type='ball'/>
        <joint type='slide'/>
    """,
    "mujoco": """
        <default/>
        <asset/>
        <asset><hfield name='hills' nrow='3' ncol='3' size='1 1 1 1'/></asset>
        <asset><mesh name='flat' vertex='0 0 0 1 0 0 0 1 0'/></asset>
        <contact/>
        <equality/>
        <tendon/>
        <actuator/>
        <sensor/>
        <keyframe/>
        <option><flag sleep='enable'/></option>
        <size memory='1K'/>
        <size nkey='3'/>
        <extension/>
        <keyframe><key/></keyframe>
        <option timestep='0'/>
        <sensor><clock/></sensor>
        <custom/>
        <nosuch/>
        <sensor><user dim='2'/></sensor>
        <option noslip_iterations='2'/>
        <option density='9' cone='elliptic'/>
        <deformable/>
        <visual/>
        <statistic meaninertia='0'/>
        <include file='none.xml'/>
        <actuator><general/></actuator>
        <option><flag contact='disable'/></option>
    """,
}


def mutated(xml: str, seed: int) -> str:
    """The XML with one to three random changes."""
    rng = random.Random(seed)
    for _ in range(rng.choice((1, 1, 2, 3))):
        change = rng.choice((*4 * [_number], _attribute, _attribute, _structure, _structure, _text))
        xml = change(xml, rng)
    return xml


def _number(xml: str, rng: random.Random) -> str:
    """One number is another one, is missing, or is there twice."""
    found = list(NUMBER.finditer(xml))
    if not found:
        return xml
    at = rng.choice(found)
    old = at.group()
    new = rng.choice((rng.choice(EDGES), f"{float(old) * rng.uniform(0.5, 2):.6g}", f"-{old}"))
    new = rng.choice((new, new, new, new, "", f"{old} {old}"))
    return xml[: at.start()] + new + xml[at.end() :]


def _attribute(xml: str, rng: random.Random) -> str:
    """An attribute is missing, is another word, or is new."""

    def change(element: ET.Element) -> None:
        names = list(element.attrib)
        if element.tag in ATTRIBUTES and rng.random() < 0.6:
            name, _, value = rng.choice(_lines(ATTRIBUTES[element.tag])).partition("=")
            element.set(name, value.strip("'"))
        elif names:
            name = rng.choice(names)
            if rng.random() < 0.4:
                del element.attrib[name]
            else:
                element.set(name, rng.choice(WORDS))

    return _edited(xml, rng, change)


def _structure(xml: str, rng: random.Random) -> str:
    """An element is gone, is there twice, is elsewhere, or is new."""

    def change(element: ET.Element) -> None:
        children = list(element)
        if element.tag in ELEMENTS and rng.random() < 0.7:
            new = ET.fromstring(rng.choice(_lines(ELEMENTS[element.tag])))
            element.insert(rng.randrange(len(children) + 1), new)
        elif children:
            child = rng.choice(children)
            element.remove(child) if rng.random() < 0.5 else element.append(copy.deepcopy(child))

    return _edited(xml, rng, change)


def _text(xml: str, rng: random.Random) -> str:
    """A piece is gone, is there twice, or is another character."""
    start = rng.randrange(len(xml))
    stop = min(len(xml), start + rng.choice((1, 1, 1, 5, 50, 10_000)))
    return (
        xml[:start]
        + rng.choice(("", 2 * xml[start:stop], rng.choice("<>\"'=/&\x00é 9")))
        + xml[stop:]
    )


def _edited(xml: str, rng: random.Random, change: Callable[[ET.Element], None]) -> str:
    """The XML after a change of one element; as it is, where it is malformed."""
    try:
        root = ET.fromstring(xml)
    except ET.ParseError:
        return xml
    elements = list(root.iter())
    known = [element for element in elements if element.tag in (*ATTRIBUTES, *ELEMENTS)]
    change(rng.choice(rng.choice((elements, known))))
    return ET.tostring(root, encoding="unicode")


def _lines(text: str) -> list[str]:
    return [line.strip() for line in text.strip().splitlines()]

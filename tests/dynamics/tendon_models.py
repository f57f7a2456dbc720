"""MJCF with spatial tendons: straight, over every surface, with pulleys; and what acts on them."""

BODIES = """
<site name="top" pos="0 0 1.2"/><site name="left" pos="-.6 .3 .6"/>
<site name="right" pos=".7 .2 .5"/>
<geom name="world" type="sphere" size=".15" pos="0 .1 .8"/>
<body name="a" pos="0 0 .5">
  <joint name="a" axis="0 1 0" damping=".1"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".05"/>
  <geom name="ball" type="sphere" size=".12" pos=".1 .05 .1" euler="10 20 30"/>
  <geom name="drum" type="cylinder" size=".1 .3" pos=".3 0 .1" euler="80 20 10"/>
  <site name="a0" pos="-.1 .1 .2"/><site name="a1" pos=".4 .05 .25"/>
  <site name="over" pos=".1 .05 .3"/><site name="in" pos=".12 .05 .12"/>
  <site name="drum_side" pos=".3 0 -.3"/><site name="drum_in" pos=".31 .01 .1"/>
  <body name="b" pos=".5 0 0">
    <joint name="b" type="ball" damping=".1"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".04"/>
    <geom name="knee" type="cylinder" size=".08 .2" euler="90 5 0"/>
    <site name="b0" pos=".2 .05 .12"/><site name="b1" pos=".35 -.05 .1"/>
    <site name="knee_side" pos="0 .02 .2"/>
  </body>
</body>
<body name="c" pos=".2 .8 .4"><freejoint/><geom type="box" size=".1 .2 .1" mass="1"/>
  <site name="c0" pos=".1 .1 .1"/></body>
"""

TENDONS = """
<spatial name="straight" {0}><site site="a1"/><site site="b0"/><site site="c0"/></spatial>
<spatial name="pulley" {1}><site site="a0"/><site site="b1"/><pulley divisor="2"/><site site="b1"/>
  <site site="c0"/><pulley divisor="3"/><site site="top"/><site site="a1"/></spatial>
<spatial name="sphere" {2}><site site="left"/><geom geom="ball"/><site site="b1"/></spatial>
<spatial name="sphere_side" {3}><site site="left"/><geom geom="ball" sidesite="over"/>
  <site site="b0"/></spatial>
<spatial name="sphere_inside" {4}><site site="left"/><geom geom="ball" sidesite="in"/>
  <site site="b1"/></spatial>
<spatial name="cylinder" {5}><site site="a0"/><geom geom="drum"/><site site="b0"/></spatial>
<spatial name="cylinder_side" {6}><site site="top"/><geom geom="drum" sidesite="drum_side"/>
  <site site="b1"/><geom geom="knee" sidesite="knee_side"/><site site="c0"/></spatial>
<spatial name="cylinder_inside" {7}><site site="right"/><geom geom="drum" sidesite="drum_in"/>
  <site site="left"/></spatial>
<spatial name="world" {8}><site site="right"/><geom geom="world"/><site site="left"/>
  <geom geom="ball"/><site site="c0"/></spatial>
"""

FEATURES = (
    'stiffness="20 3 1" damping="1"',
    'stiffness="10" springlength=".2 .5" damping="1 .3 .2"',
    'limited="true" range="0 .9" solreflimit=".03 1.1"',
    'frictionloss=".5"',
    'limited="true" range=".2 .7" margin=".02"',
    'damping=".5" limited="true" range="0 .5"',
    "",
    'actuatorfrcrange="-1 1"',
    "",
)

REST = """
<equality><tendon tendon1="straight" tendon2="pulley" polycoef=".1 .5 .2 0 0"/>
  <tendon tendon1="world"/></equality>
<actuator><motor tendon="sphere" gear="3"/><muscle tendon="cylinder" force="30" lengthrange=".2 1"/>
  <position tendon="cylinder_side" kp="30" kv="2" gear="-1"/><motor joint="a"/>
  <motor tendon="cylinder_inside" gear="10"/><motor tendon="knot" gear="2"/></actuator>
<sensor><tendonpos tendon="sphere_side"/><tendonvel tendon="cylinder"/>
  <tendonlimitpos tendon="sphere_inside"/><tendonlimitfrc tendon="cylinder"/>
  <tendonactuatorfrc tendon="cylinder"/><actuatorpos actuator="2"/></sensor>
"""


def tendon_model(option: str = "", features: tuple[str, ...] = FEATURES, rest: str = REST) -> str:
    """MJCF of a model that has them all.

    Args:
      option: attributes of `<option>`.
      features: attributes of the tendons.
      rest: equalities, actuators and sensors.
    """
    fixed = '<fixed name="knot" stiffness="2"><joint joint="a" coef="2"/></fixed>'
    actuators = rest.replace("<position", '<position name="2"')
    return (
        f'<mujoco><option timestep="0.002" {option}/><compiler autolimits="true"/>'
        '<default><geom contype="0" conaffinity="0" density="800"/></default>'
        f"<worldbody>{BODIES}</worldbody><tendon>{TENDONS.format(*features)}{fixed}</tendon>"
        f"{actuators}</mujoco>"
    )

"""MJCF that exercises every smooth force and every actuator of this package."""

BODIES = """
<body gravcomp="0.5">
  <joint name="hinge" axis="0 1 0" damping="1 .2 .3" stiffness="3 1 .5" springref="20" armature=".5"
         actuatorgravcomp="true"/>
  <geom size=".1" mass="1" pos=".1 0 .3"/>
  <site name="lower" pos=".1 .2 .3" euler="10 20 30"/>
  <body pos="0 0 .5" gravcomp="1.5">
    <joint name="ball" type="ball" damping=".2 .1 .3" stiffness="2 1 1"/>
    <geom type="box" size=".1 .2 .3" pos="0 0 .2" mass="1"/>
    <site name="upper" pos=".1 .2 .3" euler="50 20 30"/>
    <body>
      <joint name="left" type="slide" axis="1 1 0" actuatorfrcrange="-1 1"/>
      <geom type="box" size=".1 .2 .1" mass="2"/>
    </body>
    <body>
      <joint name="right" type="slide" axis="1 0 0"/>
      <geom type="box" size=".1 .2 .1" mass="3"/>
    </body>
  </body>
</body>
<body>
  <freejoint name="free"/>
  <geom type="box" size=".1 .2 .3" pos=".1 .2 .1" mass="2"/>
  <site name="alone"/>
</body>
<body pos="1 2 3">
  <joint name="sprung" type="free" stiffness="2 1 1" damping=".5"/>
  <geom type="box" size=".1 .2 .3" pos=".1 .2 .1" mass="4"/>
</body>
"""

TENDONS = """
<fixed name="near" stiffness="3 1 1" {near} springlength="-.1 .2" actuatorfrcrange="-.5 1">
  <joint joint="hinge" coef="2"/><joint joint="left" coef="-.5"/>
</fixed>
<fixed name="far" {far} stiffness="2">
  <joint joint="right" coef="2"/><joint joint="left" coef="-.5"/>
</fixed>
"""

ACTUATORS = """
<position joint="hinge" kp="1" kv=".3" damping="3 .1 .2" armature="7" gear="2" ctrlrange="-1 1"/>
<position joint="ball" kp="1.5" gear="1 .5 .2" damping="2" armature="3"/>
<general joint="ball" gear="1 .5 .2" dyntype="integrator" gainprm="2" biastype="affine"
         biasprm="0 -2 -.1"/>
<position tendon="near" kp="1.5" gear="2" damping="2"/>
<motor tendon="near" gear="2"/>
<general jointinparent="ball" gear="1 .3 -.2" gaintype="affine" gainprm="1 .1 -.2" dyntype="filter"
         dynprm=".1" actrange="-.1 .5"/>
<general joint="free" gear="1 2 3 4 5 6" gaintype="affine" gainprm="1 .1 -.2" dynprm=".1"
         dyntype="filterexact" actearly="true"/>
<general jointinparent="free" gear="1 2 3 4 5 6" forcerange="-1 1" biastype="affine"
         biasprm=".1 -.2 -.3"/>
<general site="lower" gear="1 2 3 4 5 6" gaintype="affine" gainprm="1 .1 -.2" ctrlrange="-1 1"/>
<general site="upper" refsite="lower" gear="1 2 3 4 5 6" gaintype="affine" gainprm="1 .1 -.2"/>
<position site="upper" refsite="lower" gear="0 0 0 .1 .2 .1" kp="1.4" kv=".2"/>
<intvelocity site="upper" refsite="lower" gear="0 0 0 .1 .2 .1" kp="1.4" kv=".2"
             actrange="-1000 1000"/>
<general site="upper" refsite="alone" gear="1 2 3 4 5 6"/>
<general joint="left" group="2" gainprm="3" dyntype="integrator"/>
<muscle joint="hinge" lengthrange="-1 1"/>
<muscle joint="left" lengthrange="-1 1" force="3" timeconst=".1 .2"/>
<muscle tendon="near" lengthrange="-1 1" tausmooth=".3"/>
<general joint="right" biastype="affine" biasprm="1 -2 -.1"/>
"""

FLUID = 'density="1.2" viscosity=".3" wind="1 2 3"'

# Only hinges and slides: what every integrator must agree on to the last digits.
ARM = """
<mujoco><option integrator="{integrator}" timestep="0.01"/>
<default><geom type="capsule" size=".05"/></default>
<worldbody><body><joint name="a" axis="0 1 0" damping="{damping}" armature=".01"/>
  <geom fromto="0 0 0 .4 0 0"/>
  <body pos=".4 0 0"><joint name="b" axis="0 1 .3" stiffness="2"/><geom fromto="0 0 0 .4 0 .1"/>
    <body pos=".4 0 .1"><joint name="c" type="slide" axis="1 0 .2" damping=".3 .1 .2"/>
      <geom fromto="0 0 0 .2 0 0"/></body></body></body></worldbody>
<actuator><muscle joint="a" lengthrange="-1 1" force="20"/>
  <general joint="b" dyntype="filterexact" dynprm=".03" gainprm="2"/>
  <velocity joint="c" kv="2"/></actuator></mujoco>
"""


def kitchen_sink(
    integrator: str = "Euler",
    option: str = "",
    actuators: str = ACTUATORS,
    tendon_damping: bool = True,
) -> str:
    """MJCF with all of the above.

    Args:
      integrator: MuJoCo's name of the integrator.
      option: further attributes of `<option>`.
      actuators: what is between the actuator tags.
      tendon_damping: whether the tendons have dampers.
    """
    dampers = {"near": 'damping="2 1 1"', "far": 'damping="2 1 1"'} if tendon_damping else {}
    tendons = TENDONS.format(**({"near": "", "far": ""} | dampers))
    return (
        f'<mujoco><option integrator="{integrator}" timestep="0.01" {option}/>'
        '<default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{BODIES}</worldbody><tendon>{tendons}</tendon>"
        f"<actuator>{actuators}</actuator></mujoco>"
    )


def arm(integrator: str = "Euler", damping: float = 0.5) -> str:
    """MJCF of a planar arm with a muscle, a filter and a velocity servo."""
    return ARM.format(integrator=integrator, damping=damping)

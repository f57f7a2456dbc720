"""Small scenes that between them have every kind of constraint and every parameter of one."""

# Free bodies on a floor, none of which touches another: nothing couples two moving links.
FLOOR = """
<mujoco>
  <option timestep="0.002" impratio="3"/>
  <default><geom friction=".6 .01 .002" contype="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="1" friction=".3 .005 .0001"
      solref=".03 .8"/>
    <body pos="0 0 .095"><freejoint/><geom type="sphere" size=".1" condim="1"/></body>
    <body pos="1 0 .098"><freejoint/><geom type="box" size=".12 .09 .1" condim="3"/></body>
    <body pos="2 0 .098"><freejoint/><geom type="sphere" size=".1" condim="4" priority="1"
      friction=".9 .05 .001" solref="-3000 -60"/></body>
    <body pos="3 0 .099" quat="1 1 0 0"><freejoint/>
      <geom type="capsule" size=".1 .2" condim="6" friction=".7 .03 .02" euler="90 0 0"/></body>
    <body pos="4 0 .12"><freejoint/>
      <geom type="cylinder" size=".1 .1" margin=".03" gap=".02" solmix="4"
        solimp=".7 .99 .02 .3 3" solref="-800 -30"/></body>
    <body pos="5 0 .1"><freejoint/>
      <geom name="pair" type="sphere" size=".1" contype="0" conaffinity="0"/></body>
    <body pos="6 0 .1"><freejoint/>
      <geom type="ellipsoid" size=".1 .15 .12" condim="3" solimp=".9 .9 .001"
        solref=".001 1"/></body>
  </worldbody>
  <contact><pair geom1="floor" geom2="pair" condim="6" margin=".01" friction=".5 .7 .02 .01 .03"
    solref=".02 1" solreffriction=".05 .7"/></contact>
</mujoco>
"""

# Bodies that touch each other: their contacts couple moving links.
PILE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="0 0 1" condim="1"/>
    <body name="a" pos="0 0 .1"><freejoint/>
      <geom type="sphere" size=".1" condim="1"/>
      <body pos="0 .3 0"><joint axis="1 0 0" limited="true" range="-10 10"/>
        <geom type="capsule" fromto="0 -.1 0 0 .1 .1" size=".06" condim="4"/></body></body>
    <body name="b" pos=".02 0 .295"><freejoint/>
      <geom type="capsule" fromto="-.1 0 0 .1 .05 0" size=".1" condim="3"/></body>
    <body name="c" pos="0 .02 .49"><freejoint/><geom type="sphere" size=".1" condim="6"/></body>
    <body name="ghost" pos="0 0 .4"><freejoint/><geom type="sphere" size=".1" condim="1"/></body>
  </worldbody>
  <contact>
    <exclude body1="ghost" body2="a"/><exclude body1="ghost" body2="b"/>
    <exclude body1="ghost" body2="c"/>
  </contact>
</mujoco>
"""

# Dry friction and limits of joints and of tendons.
LIMITS = """
<mujoco>
  <option timestep="0.002"/>
  <default><geom type="capsule" fromto="0 0 0 .2 0 -.05" size=".03" contype="0"/></default>
  <worldbody>
    <body><joint name="a" type="hinge" axis="0 1 0" limited="true" range="-10 12"
        frictionloss=".3"/>
      <geom/>
      <body pos=".2 0 0"><joint name="b" type="slide" axis="1 0 1" limited="true" range="-.02 .03"
        margin=".004" solreflimit="-900 -20" solimplimit=".8 .95 .01 .4 2"/><geom/>
        <body pos=".2 0 0"><joint name="c" type="hinge" axis="0 1 1" frictionloss=".05"
          solreffriction=".04 1" solimpfriction=".8 .9 .01"/><geom/></body></body></body>
    <body pos="0 1 0"><joint type="ball" limited="true" range="0 20" margin=".04"
      solreflimit=".03 .9" frictionloss=".02"/><geom/>
      <body pos=".2 0 0"><joint name="d" axis="0 0 1" limited="true" range="-5 5"/><geom/></body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="ac" limited="true" range="-.1 .1" frictionloss=".2" margin=".01">
      <joint joint="a" coef="1"/><joint joint="c" coef="-.7"/></fixed>
    <fixed name="bd" limited="true" range="-.02 .05" solreflimit="-500 -20" frictionloss=".1"
      solreffriction=".05 .8"><joint joint="b" coef="2"/><joint joint="d" coef=".5"/></fixed>
  </tendon>
  <actuator><motor joint="c" gear="3"/><motor joint="d" gear="2"/></actuator>
</mujoco>
"""

# Equalities by bodies and by sites, between bodies and with the world, of joints and of tendons.
EQUALITIES = """
<mujoco>
  <option timestep="0.002"/>
  <default><geom type="box" size=".1 .05 .03" contype="0"/></default>
  <worldbody>
    <site name="world" pos="0 0 1" euler="10 20 30"/>
    <body name="a" pos="0 0 .9"><freejoint/><geom/>
      <site name="a" pos=".1 .02 0" euler="5 0 40"/></body>
    <body name="b" pos="1 0 0"><joint type="ball"/><geom/>
      <body name="c" pos=".3 0 0"><joint name="h" axis="0 1 0"/><geom/><site name="c" pos=".1 0 0"/>
      </body></body>
    <body name="d" pos="1.5 0 0"><freejoint/><geom/>
      <site name="d" pos="-.1 0 0" euler="0 0 20"/></body>
    <body name="e" pos="2 0 0"><joint name="s" type="slide" axis="0 0 1"/><geom/>
      <body name="f" pos=".3 0 0"><joint name="k" axis="1 1 0"/><geom/></body></body>
    <body name="g" pos="3 0 0"><freejoint/><geom/></body>
  </worldbody>
  <tendon>
    <fixed name="t"><joint joint="h" coef="1"/><joint joint="k" coef=".5"/></fixed>
    <fixed name="u"><joint joint="s" coef="2"/></fixed>
  </tendon>
  <equality>
    <connect site1="world" site2="a"/>
    <connect body1="c" body2="e" anchor=".1 .2 .3" solref=".03 1"/>
    <connect body1="g" anchor=".1 0 0" solref="-400 -30"/>
    <weld site1="c" site2="d" torquescale=".3" solimp=".8 .95 .1 .4 3"/>
    <weld body1="g" body2="d" relpose="1 .1 0 .9 .1 .2 0" anchor=".1 .1 0" torquescale=".5"/>
    <weld body1="a" solref=".1 1"/>
    <weld body1="b" body2="g" active="false"/>
    <joint joint1="h" joint2="k" polycoef=".05 .7 .2 -.3 .4"/>
    <joint joint1="s" polycoef=".02 0 0 0 0" solref="-100 -5"/>
    <tendon tendon1="t" tendon2="u" polycoef=".01 -.5 .3 .2 .1"/>
    <tendon tendon1="u" polycoef="-.02 0 0 0 0" solimp=".5 .9 .01"/>
  </equality>
</mujoco>
"""

SCENES = {"floor": FLOOR, "pile": PILE, "limits": LIMITS, "equalities": EQUALITIES}

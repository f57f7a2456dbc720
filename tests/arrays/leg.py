"""A small robot whose solver iterates: a trunk on one leg, standing on the ground."""

LEG = """
<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1" conaffinity="0"/>
    <body pos="0 0 .6">
      <joint type="slide" axis="0 0 1"/>
      <joint type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".1" contype="0"/>
      <body>
        <joint name="hip" axis="0 1 0" damping=".1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 -.3" size=".04" contype="0"/>
        <body pos=".1 0 -.3">
          <joint name="knee" axis="0 1 0" damping=".1" limited="true" range="-90 10"/>
          <geom type="capsule" fromto="0 0 0 -.1 0 -.27" size=".04" contype="0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="hip" gear="9"/><motor joint="knee" gear="9"/></actuator>
</mujoco>
"""

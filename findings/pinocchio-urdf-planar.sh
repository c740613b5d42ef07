#!/usr/bin/env bash
# Pinocchio 4.1.0: `buildModelFromXML` ignores the axis of a URDF's planar joint without a warning:
# the body moves in the plane of x and y, whatever the normal of the plane is in the file.
# Seen: with the normal along y, the second coordinate moves the body along y, out of its plane.
# Remedy: turn the joint's origin so that the normal is z. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pinocchio

model = pinocchio.buildModelFromXML("""
<robot name="planar">
  <link name="world"/>
  <link name="body">
    <inertial>
      <mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="planar" type="planar">
    <parent link="world"/>
    <child link="body"/>
    <axis xyz="0 1 0"/>
  </joint>
</robot>
""")
data, q = model.createData(), pinocchio.neutral(model)
q[1] = 1.0
pinocchio.forwardKinematics(model, data, q)
place = data.oMi[1].translation
print(place)
assert place[1] == 1.0 and place[2] == 0.0, "Pinocchio now reads the axis"
PYTHON

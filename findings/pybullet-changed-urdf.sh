#!/usr/bin/env bash
# PyBullet 3.2.7: `loadURDF` and `loadMJCF` keep the text of each file they have read for the life of a
# connection, over `resetSimulation` too: a file that has been written again is loaded as it was.
# Seen: one URDF written with masses of 1, 2 and 3 kg is loaded with 1, 1 and 1 kg, so a sweep over designs
# runs the first design each time. Remedy: `setPhysicsEngineParameter(enableFileCaching=0)`, or a new name
# for each design. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pybullet==3.2.7 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import pybullet

URDF = """<robot name="leg"><link name="leg"><inertial><mass value="{}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def loaded(mass):
    with open("leg.urdf", "w") as file:
        file.write(URDF.format(mass))
    pybullet.resetSimulation()
    return pybullet.getDynamicsInfo(pybullet.loadURDF("leg.urdf"), -1)[0]


pybullet.connect(pybullet.DIRECT)
kept = [loaded(mass) for mass in (1, 2, 3)]
pybullet.setPhysicsEngineParameter(enableFileCaching=0)
read = [loaded(mass) for mass in (1, 2, 3)]
print(kept, read)
assert read == [1.0, 2.0, 3.0]
assert kept == [1.0, 1.0, 1.0], "PyBullet reads the file again now"
PYTHON

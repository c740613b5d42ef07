#!/usr/bin/env bash
# Pinocchio 4.1.0: `buildModelFromMJCF` does not normalize the axis of `axisangle`, as MuJoCo does:
# the placement of a body gets a matrix that is no rotation, without a warning.
# Seen: axisangle="0 2 0 30" has the determinant 3.44, and a mass 1 m below the joint is 1.32 m away
# from it; "0 1 0 30" gives 1 and 1 m. Remedy: write `quat`, or an axis of length 1.
# Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
import pinocchio


def leg(axis):
    with open("leg.xml", "w") as file:
        file.write(f"""<mujoco model="leg"><worldbody><body axisangle="{axis} 30">
        <joint axis="0 1 0"/><geom size="0.1" pos="0 0 -1" mass="1"/></body></worldbody></mujoco>""")
    model = pinocchio.buildModelFromMJCF("leg.xml")
    center = pinocchio.centerOfMass(model, model.createData(), np.zeros(1))
    return np.linalg.det(model.jointPlacements[1].rotation), np.linalg.norm(center)


unit, longer = leg("0 1 0"), leg("0 2 0")
print(unit, longer)
assert np.allclose(unit, 1.0)
assert longer[0] > 3.4 and longer[1] > 1.3, "Pinocchio normalizes the axis now"
PYTHON

#!/usr/bin/env bash
# MuJoCo 4.0.0: `model.geom_quat` of a geom that was compiled without a turn is ignored by
# `mj_kinematics`; of one that was compiled with a turn it is read.
# The compiler notes that the frames are the same (`geom_sameframe`), and kinematics trusts the note.
# Seen: a plane whose quaternion is changed to a tilt of 0.1 rad keeps the normal (0, 0, 1).
# Remedy: set `model.geom_sameframe[i] = 0`. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import math

import mujoco

PLANE = '<mujoco><worldbody><geom name="g" type="plane" size="1 1 1"{}/></worldbody></mujoco>'


def normal(turn, same=None):
    model = mujoco.MjModel.from_xml_string(PLANE.format(turn))
    data = mujoco.MjData(model)
    model.geom("g").quat[:] = math.cos(0.05), 0.0, math.sin(0.05), 0.0
    if same is not None:
        model.geom_sameframe[0] = same
    mujoco.mj_kinematics(model, data)
    return data.geom("g").xmat.reshape(3, 3)[:, 2]


print(normal(""), normal(' euler="0 1 0"'), normal("", 0))
assert normal(' euler="0 1 0"')[0] > 0.09 and normal("", 0)[0] > 0.09
assert normal("")[0] == 0.0, "MuJoCo now reads the quaternion"
PYTHON

#!/usr/bin/env bash
# MuJoCo 4.0.0: a camera that is made by `MjvCamera()` does not take `<global orthographic="true"/>`
# of its model, and takes the height of that picture in m, `fovy`, for an angle in degrees.
# `Renderer.update_scene(data)` has another camera, by `mjv_defaultFreeCamera`, which takes both.
# Seen: with fovy="2" the picture of a camera made by hand is a cone of 2 degrees, which is empty but
# for what lies on its axis; no error. Remedy: `camera.orthographic = 1`. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import math

import mujoco

MODEL = """<mujoco><visual><global orthographic="true" fovy="2"/></visual>
<worldbody><geom type="sphere" size="0.1"/></worldbody></mujoco>"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene = mujoco.MjvScene(model, 10)


def seen(camera):
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, everything, scene)
    view = scene.camera[0]
    return view.orthographic, view.frustum_top, view.frustum_top / view.frustum_near


by_hand, default = mujoco.MjvCamera(), mujoco.MjvCamera()
mujoco.mjv_defaultFreeCamera(model, default)
before = seen(by_hand)
by_hand.orthographic = 1
print(before, seen(default), seen(by_hand))
assert seen(default)[:2] == seen(by_hand)[:2] == (1, 1.0)  # half of 2 m
assert before[0] == 0, "a camera made by hand is orthographic now"
assert math.isclose(before[2], math.tan(math.radians(1.0)), rel_tol=1e-3)
PYTHON

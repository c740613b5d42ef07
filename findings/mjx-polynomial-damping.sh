#!/usr/bin/env bash
# MJX 3.17.0 with MuJoCo 4.0.0, the newest of each: `mjx.put_model` takes a joint whose damping or
# stiffness is a polynomial (MuJoCo >= 3.7) and keeps the linear coefficient alone. MJX's page promises
# an exception for a model with features that it does not support.
# Seen: a pendulum with damping="0.1 0.9" is after 0.5 s at 0.154 rad by MuJoCo and at -0.358 rad by
# MJX, which is MuJoCo's result for damping="0.1". Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mujoco==4.0.0 mujoco-mjx==3.17.0 jax==0.10.2 numpy==2.4.6
JAX_PLATFORMS=cpu "$folder/venv/bin/python" - <<'PYTHON'
import jax
import mujoco
from mujoco import mjx

step = jax.jit(mjx.step)


def swing(joint):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.01"/><worldbody><body>
    <joint axis="0 1 0" {joint}/><geom size="0.1" pos="0 0 -0.5" mass="1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[0] = 0.8
    there, state = mjx.put_model(model), mjx.put_data(model, data)
    for _ in range(50):
        mujoco.mj_step(model, data)
        state = step(there, state)
    return float(data.qpos[0]), float(state.qpos[0])


for linear, polynomial in (('damping="0.1"', 'damping="0.1 0.9"'), ('stiffness="1"', 'stiffness="1 5"')):
    alone, whole = swing(linear), swing(polynomial)
    print(polynomial, "MuJoCo", whole[0], "MJX", whole[1], "linear part", alone[0])
    assert abs(alone[0] - alone[1]) < 1e-4 and abs(whole[0] - alone[0]) > 0.1
    assert abs(whole[1] - alone[1]) < 1e-6, "MJX reads the polynomial now"
PYTHON

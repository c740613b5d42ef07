#!/usr/bin/env bash
# Pinocchio 4.1.0: `buildModelFromMJCF` drops all that is inside a `<frame>`, without a warning: bodies
# with their joints, and geoms with their masses. For MuJoCo a frame is a pure change of coordinates.
# Seen: a hip of 10 kg with two legs of 1 kg has the joints hip, right, left and 12 kg; with the left leg
# inside a frame it has the joints hip, right and 11 kg. Remedy: place the bodies without frames (files
# that MuJoCo's `mj_saveLastXML` writes keep them). Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import pinocchio

LEG = """<body name="{0}" pos="0 {1} 0"><joint name="{0}" axis="0 1 0"/>
<geom size="0.1" pos="0 0 -1" mass="1"/></body>"""


def walker(left):
    with open("walker.xml", "w") as file:
        file.write(f"""<mujoco model="walker"><worldbody><body name="hip">
        <joint name="hip" axis="0 1 0"/><geom size="0.1" mass="10"/>{LEG.format("right", 0)}{left}
        </body></worldbody></mujoco>""")
    model = pinocchio.buildModelFromMJCF("walker.xml")
    return list(model.names)[1:], round(pinocchio.computeTotalMass(model), 9)


plain = walker(LEG.format("left", 0.2))
framed = walker(f'<frame pos="0 0.2 0">{LEG.format("left", 0)}</frame>')
print(plain, framed)
assert plain == (["hip", "right", "left"], 12.0)
assert framed == (["hip", "right"], 11.0), "Pinocchio reads frames now"
PYTHON

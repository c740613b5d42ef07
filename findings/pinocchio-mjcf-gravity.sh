#!/usr/bin/env bash
# Pinocchio 4.1.0: `buildModelFromMJCF` ignores the gravity of <option gravity="..."/> without a
# warning; `model.gravity` is (0, 0, -9.81) whatever the file says.
# A slope that is written as tilted gravity, or another planet, is lost.
# Seen: gravity (0.353, 0, -9.804) of the file is read as (0, 0, -9.81).
# Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pin==4.1.0 numpy==2.4.6
cat > "$folder/tilted.xml" <<'XML'
<mujoco>
  <option gravity="0.353 0 -9.804"/>
  <worldbody>
    <body name="body">
      <joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    </body>
  </worldbody>
</mujoco>
XML
"$folder/venv/bin/python" - "$folder/tilted.xml" <<'PYTHON'
import sys

import pinocchio

gravity = pinocchio.buildModelFromMJCF(sys.argv[1]).gravity.linear
print(gravity)
assert gravity[0] == 0.0 and gravity[2] == -9.81, "Pinocchio now reads gravity"
PYTHON

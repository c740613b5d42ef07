#!/usr/bin/env bash
# tianshou 2.0.1: the first example of its description fails with its own CartPole-v1.
# `EnvFactoryRegistered` passes the example's `training_seed` and `test_seed` to `gymnasium.make`.
# Seen: TypeError: CartPoleEnv.__init__() got an unexpected keyword argument 'training_seed'
# The example also imports joblib, which only `tianshou[eval]` installs. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet torch==2.13.0
"$folder/venv/bin/pip" install --quiet "tianshou[eval]==2.0.1" gymnasium==1.4.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON' > example.py
import re
from importlib.metadata import metadata

data = metadata("tianshou")
text = str(data.get_payload() or data["Description"])
blocks = re.findall(r"```python\n(.*?)```", text, re.S)
print(next(block for block in blocks if "DQNExperimentBuilder" in block))
PYTHON
if venv/bin/python example.py > said 2>&1; then
    echo "the example runs now"
    exit 1
fi
tail -1 said
grep -q "unexpected keyword argument 'training_seed'" said

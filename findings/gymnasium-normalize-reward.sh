#!/usr/bin/env bash
# Gymnasium 1.4.0: the vector wrapper `NormalizeReward` divides the same rewards by a larger number in the
# autoreset mode NEXT_STEP, the default, than in SAME_STEP and DISABLED: its discounted return goes on over
# a time limit into the next episode in NEXT_STEP, and begins again at 0 in the two others.
# Seen: after 100 episodes of Pendulum-v1 without torque and with a limit of 10 steps, the same rewards are
# divided by 124.8 in NEXT_STEP, and by 23.2 in SAME_STEP and DISABLED. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gymnasium==1.4.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import gymnasium as gym
import numpy as np


def scale(mode, episodes=100):
    envs = gym.make_vec("Pendulum-v1", 2, "sync", {"autoreset_mode": mode}, max_episode_steps=10)
    envs = gym.wrappers.vector.NormalizeReward(envs, gamma=0.99)
    envs.reset(seed=0)
    paid = 0.0
    while episodes:
        _, reward, _, truncated, _ = envs.step(np.zeros((2, 1), np.float32))
        divisor = np.sqrt(envs.return_rms.var + envs.epsilon)
        paid += reward.sum() * divisor
        episodes -= truncated[0]
        if truncated[0] and mode == "Disabled":
            envs.reset(options={"reset_mask": truncated})
    return round(float(paid), 3), round(float(divisor), 3)


following, same, disabled = (scale(mode) for mode in ("NextStep", "SameStep", "Disabled"))
print("sum of rewards and divisor:", following, same, disabled)
assert following[0] == same[0] == disabled[0]
assert max(same[1], disabled[1]) < 1.1 * min(same[1], disabled[1])
assert following[1] > 4 * same[1], "NEXT_STEP ends returns at time limits now"
PYTHON

#!/usr/bin/env bash
# CasADi 3.8.2: `integrator` takes a zero crossing as located after 3 iterations (`max_event_iter`) even
# where `event_tol` (1e-6) is not met, without a word (it says only that events are experimental).
# Seen: a ball that falls from 1 m (g = 1 m/s2) and bounces with 0.8 has after 3 s a speed that is wrong by
# 0.086 m/s, with 20 and with 2000 steps alike, and its derivative by the first height is wrong by 0.042 of
# 1.273 1/s. Remedy: max_event_iter=50, with which both are right to 1e-6. Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet casadi==3.8.2 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import casadi as ca
import numpy as np

x = ca.MX.sym("x", 2)
ball = {"x": x, "ode": ca.vertcat(x[1], -1), "zero": x[0]}
bounce = ca.Function("bounce", {"x": x, "post_x": ca.vertcat(x[0], -0.8 * x[1])}, ca.event_in(), ca.event_out())
impact = 2**0.5  # s and m/s
exact = np.array([0.8 * impact * (3 - impact) - (3 - impact) ** 2 / 2, 0.8 * impact - (3 - impact)])
slope = 1.8 / impact  # of the last speed by the first height


def errors(**options):
    run = ca.integrator("run", "rk", ball, 0, 3.0, {"transition": bounce, **options})
    end = run(x0=x)["xf"]
    state, jacobian = ca.Function("f", [x], [end, ca.jacobian(end, x)])([1.0, 0.0])
    return abs(state.full()[:, 0] - exact)[1], abs(jacobian.full()[1, 0] - slope)


coarse, fine = errors(number_of_finite_elements=20), errors(number_of_finite_elements=2000)
good = errors(max_event_iter=50)
print(coarse, fine, good)
assert max(good) < 2e-6
assert min(coarse[0], fine[0]) > 0.08, "CasADi meets the tolerance of events now"
PYTHON

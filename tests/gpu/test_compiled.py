"""What a device would run, as far as it can be known without one."""

import os
import subprocess
import sys
from importlib.util import find_spec
from shutil import which

import pytest

EVERYTHING = """{
    "slope": (0.0, 0.06), "terrain": {"rough": {"height_std": 0.002}}, "terrain_lookahead": 2,
    "pushes": {"rate": 0.3, "impulse": (-0.03, 0.03)}, "observation_noise": 0.01, "action_noise":
    0.1, "action_delay": 2, "command": (0.1, 0.2), "domain_randomization": {"foot_radius": 0.1},
    "constraints": {"friction": "end", "contact": "report"},
}"""
OWN = """{"reward": {"distance": 1.0, "alive": 0.1}, "terminated": lambda step: step.time > 9.0}"""


def run(*arguments, code=0):
    """What a process says in which no device is simulated: its answer, then what it waited for."""
    reported = {name: value for name, value in os.environ.items() if name != "NUMBA_ENABLE_CUDASIM"}
    done = subprocess.run(
        [sys.executable, *arguments], env=reported, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr[-2000:]
    return done.stdout + done.stderr


needs_device = pytest.mark.skipif(
    which("nvidia-smi") is None or find_spec("numba_cuda") is None, reason="there is no device"
)


@needs_device
@pytest.mark.parametrize("name", ["kneed", "straight", "simplest"])
def test_a_stride_on_a_real_device_is_the_cpus_to_rounding(name):
    alike, off, *_ = run("-m", "tests.gpu.compiled", "device", name).split()
    assert alike == "True"
    assert float(off) < 1e-12


@needs_device
def test_a_step_waits_for_nothing():
    pytest.importorskip("torch")
    run("-m", "tests.gpu.compiled", "silence")


@pytest.mark.skipif(which("nvidia-smi") is not None, reason="there is a device")
def test_without_a_device_one_sentence_says_so():
    pretended = "import sys, types; sys.modules['numba_cuda'] = types.ModuleType('numba_cuda'); "
    installed = "" if find_spec("numba_cuda") else pretended
    code = installed + "from gym_passive_walker.devices.gpu import DeviceBatch; DeviceBatch(2)"
    assert "this needs a CUDA GPU, and there is none here" in run("-c", code, code=1)


@pytest.mark.skipif(find_spec("numba_cuda") is not None, reason="the extra is installed")
def test_without_the_extra_one_sentence_names_it():
    said = run("-c", "import gym_passive_walker.devices.gpu", code=1)
    assert 'pip install "gym-passive-walker[gpu]"' in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simplest", "straight-fitted", "kneed"])
def test_the_devices_functions_are_the_cpus_to_the_last_bit(name):
    assert float(run("-m", "tests.gpu.compiled", "cpu", name).split()[0]) == 0.0


@pytest.mark.slow
@pytest.mark.skipif(find_spec("numba_cuda") is None, reason="the extra gpu is not installed")
@pytest.mark.parametrize("capability", ["8", "9"])
@pytest.mark.parametrize("scene", ["'level'", "{'walker': 'E'}", EVERYTHING, OWN])
def test_kernels_compile_for_devices_of_two_kinds(scene, capability):
    """Each is one entry with one parameter, and allocates nothing."""
    said = run("-m", "tests.gpu.compiled", capability, scene).splitlines()
    reported = {line.split()[0]: line.split()[1:] for line in said if "_kernel" in line}
    names = "plain_kernel", "event_kernel", "reset_kernel"
    assert reported == {name: ["1", "1", "1", "False"] for name in names}

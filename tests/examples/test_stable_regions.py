"""The example of loci draws each walker's bounds of stability, within their ranges."""

import sys

import numpy as np

import gym_passive_walker as gpw
from examples import stable_regions


def test_a_heavier_hip_lets_light_feet_walk_on_steeper_slopes():
    (doubling,) = stable_regions.loci("F", "hip_mass")
    order = np.argsort(doubling.values[:, 1])
    slopes, masses = doubling.values[order].T
    assert np.all(np.diff(slopes) > 0.0) and masses[0] < 1e-12 and masses[-1] == 2.5
    for slope, mass in doubling.values[[3, -3]]:
        walker = gpw.WALKERS["F"].with_parameters(hip_mass=mass)
        stable = [gpw.find_gait(walker, share * slope).stable for share in (0.99, 1.01)]
        assert stable == [True, False]


def test_the_example_draws_a_file(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(stable_regions, "WALKERS", ("F", "E"))
    monkeypatch.setattr(sys, "argv", ["stable_regions", str(tmp_path / "regions.png")])
    stable_regions.main()
    assert (tmp_path / "regions.png").stat().st_size > 10_000
    said = capsys.readouterr().out.splitlines()
    assert [line[:2] for line in said] == ["F:", "F:"]  # E has none up to 0.2

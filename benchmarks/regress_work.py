"""Pieces of work for `regress`; they use public names only, so that older commits can run them.

Each side runs this file as a script. It prints the names of its pieces and the results of some
walks. Then it reads a name from each line, runs that piece and prints the CPU seconds.
"""

import json
import sys
import time

import gymnasium as gym
import numpy as np

import gym_passive_walker as gpw

WALKS = {"lab": 0.036, "A": 0.03, "D": 0.009}
"""A kneed, a straight-legged and the simplest walker, with a slope in rad for each."""
BATCH, ALONE = 2048, 20


def strides(pieces, walks):
    """Strides around a gait, in a batch and one after another, and with derivatives."""
    for name, slope in WALKS.items():
        gait = np.array(gpw.find_gait(name, slope).state)
        starts = np.repeat(gait[None], BATCH, axis=0)
        starts[:, 3:] *= 1.0 + 0.005 * np.random.default_rng(0).normal(size=(BATCH, 3))
        if not gpw.WALKERS[name].knees:
            starts[:, 5] = starts[:, 4]

        def many(tolerance, name=name, slope=slope, starts=starts):
            return gpw.stride(name, slope, starts, tolerance=tolerance, threads=1)

        def alone(name=name, slope=slope, start=starts[0]):
            for _ in range(ALONE):
                gpw.stride(name, slope, start, tolerance=1e-8)

        def derivatives(name=name, slope=slope, starts=starts[:256]):
            gpw.stride_jacobian(name, slope, starts)

        for tolerance in (1e-6, 1e-10):
            pieces[f"batch {name} {tolerance:g}"] = lambda f=many, tolerance=tolerance: f(tolerance)
        pieces[f"alone {name}"] = alone
        pieces[f"derivatives {name}"] = derivatives
        pieces[f"find_gait {name}"] = lambda name=name, slope=slope: gpw.find_gait(name, slope)
        walks[name] = float(np.abs(many(1e-10).state).sum())


def analyses(pieces):
    """A branch of some 130 gaits, and an optimal gait with some 30 torques."""
    pieces["gait_family C"] = lambda: gpw.gait_family("C", 0.0003, 0.1)
    pieces["optimal_gait lab"] = lambda: gpw.optimal_gait("lab", 0.18)


def steps(pieces, walks):
    """Steps of vectorized environments and of a single one."""
    for count, threads in ((64, 1), (1024, 1), (4096, 2)):
        envs = gym.make_vec("PassiveWalker-v0", num_envs=count, threads=threads)
        envs.reset(seed=0)
        envs.action_space.seed(0)
        actions = [envs.action_space.sample() for _ in range(20)]
        seen = [envs.step(action)[0] for action in actions]
        walks[f"ticks {count}"] = float(np.abs(np.array(seen, float)).sum())
        pieces[f"ticks {count}"] = lambda e=envs, actions=actions: [e.step(a) for a in actions]
    env = gym.make("PassiveWalker-v0", max_episode_steps=10**9)
    action = np.zeros(env.action_space.shape, env.action_space.dtype)

    def single():
        env.reset(seed=0)
        for _ in range(50):
            env.step(action)

    pieces["env.step"] = single


def main():
    """Run pieces of work until the input ends."""
    pieces, walks = {}, {}
    strides(pieces, walks)
    analyses(pieces)
    steps(pieces, walks)
    for piece in pieces.values():
        piece()
    print("=" + json.dumps([list(pieces), walks]), flush=True)
    for line in sys.stdin:
        piece = pieces[line.strip()]
        time.sleep(0.01)  # threads that wait for another step of an earlier piece sleep then
        start = time.process_time()
        piece()
        print(f"={time.process_time() - start:.9g}", flush=True)


if __name__ == "__main__":
    main()

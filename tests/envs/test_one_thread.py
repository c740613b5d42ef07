"""One environment is used by one thread at a time; a second one gets an error."""

import copy
import pickle
import threading

import gymnasium
import numpy as np
import pytest

from gym_passive_walker.envs.one_thread import Token

REFUSED = "another thread is using this .*: its walkers share memory.*one environment for each"
ACTIONS = np.zeros((2, 1))


def single():
    return gymnasium.make("PassiveWalker-v0", render_mode="rgb_array").unwrapped


def vector():
    return gymnasium.make_vec("PassiveWalker-v0", num_envs=2, render_mode="rgb_array")


def stable_baselines3():
    pytest.importorskip("stable_baselines3")
    from gym_passive_walker.envs.sb3 import PassiveWalkerVecEnv

    return PassiveWalkerVecEnv(2, render_mode="rgb_array")


def tensors():
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import PassiveWalkerTorchEnv

    env = PassiveWalkerTorchEnv(2, render_mode="rgb_array")
    act, env.act = env.step, lambda: act(torch.from_numpy(ACTIONS))
    return env


def act(env):
    """A step of any of them."""
    if hasattr(env, "act"):
        return env.act()
    return env.step(ACTIONS[0] if hasattr(env, "slope") else ACTIONS)


CALLS = {
    "step": act,
    "reset": lambda env: env.reset(),
    "get_state": lambda env: env.get_state(),
    "set_state": lambda env: env.set_state(STATES[type(env)]),
    "set_energy_cost": lambda env: env.set_energy_cost("net"),
    "render": lambda env: env.render(),
    "states": lambda env: env.state if hasattr(env, "slope") else getattr(env, "envs", env).states,
    "set slopes": lambda env: (
        env.set_slope(0.0) if hasattr(env, "slope") else getattr(env, "envs", env).set_slopes(0.0)
    ),
}
STATES = {}


@pytest.mark.parametrize("make", [single, vector, stable_baselines3, tensors])
def test_a_second_thread_is_refused_whatever_it_calls_and_the_first_goes_on(make, monkeypatch):
    pytest.importorskip("pygame")
    env = make()
    env.reset()
    STATES[type(env)] = env.get_state()
    batch = getattr(env, "envs", env).batch
    name = "step_alone" if make is single else "step"
    step, within, over = getattr(batch, name), threading.Event(), threading.Event()

    def slow(*arguments, **named):
        within.set()
        assert over.wait(30.0)
        return step(*arguments, **named)

    monkeypatch.setattr(batch, name, slow)
    results = []
    first = threading.Thread(target=lambda: results.append(act(env)))
    first.start()
    assert within.wait(60.0)
    monkeypatch.setattr(batch, name, step)
    before = batch.records.copy()
    try:
        for call in CALLS.values():
            with pytest.raises(RuntimeError, match=REFUSED):
                call(env)
        assert np.array_equal(batch.records, before)
    finally:
        over.set()
        first.join()
    assert len(results) == 1
    for call in CALLS.values():  # the token is there again
        env.reset()
        call(env)


def test_many_threads_that_step_one_batch_get_steps_or_errors_and_no_other_walk():
    def many():
        made = gymnasium.make_vec("PassiveWalker-v0", num_envs=200)
        made.reset(seed=0)
        return made

    shared, alone, refused, walked = many(), many(), [], []
    actions, begin = np.zeros((200, 1)), threading.Barrier(4)

    def work():
        begin.wait()
        for _ in range(50):
            try:
                walked.append(shared.step(actions)[0])
            except RuntimeError as error:
                refused.append(str(error))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(walked) + len(refused) == 200 and walked
    for _ in walked:
        last = alone.step(actions)[0]
    assert np.array_equal(shared.step(actions)[0], alone.step(actions)[0]) and len(last)


@pytest.mark.parametrize("make", [single, vector, stable_baselines3])
@pytest.mark.parametrize("raised", [KeyboardInterrupt, ValueError])
def test_an_environment_can_be_used_after_whatever_was_raised_in_a_step(make, raised, monkeypatch):
    env = make()
    env.reset()

    def interrupted(*arguments, **named):
        raise raised

    with monkeypatch.context() as during:
        for name in ("step", "step_alone", "observe"):
            during.setattr(env.batch, name, interrupted)
        with pytest.raises(raised):
            act(env)
    act(env)


@pytest.mark.parametrize("make", [single, vector, stable_baselines3])
@pytest.mark.parametrize("name", ["step", "get_state"])
def test_ctrl_c_as_the_token_is_taken_leaves_it_there(make, name):
    class Interrupted(Token):
        def pop(self, *arguments):
            super().pop(*arguments)
            raise KeyboardInterrupt

    env = make()
    env.reset()
    for holder in (env, env.batch, getattr(env, "envs", env)):
        holder.token = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        CALLS[name](env)
    assert all(len(e.token) == 1 for e in (env, getattr(env, "envs", env)))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("make", [single, vector, stable_baselines3])
def test_a_copy_has_a_token_of_its_own_that_is_free(make, copied):
    env = make()
    env.reset()
    env.batch.token.pop()  # as a thread at work has done
    other = copied(env)
    env.batch.token.append(None)
    assert other.token is other.batch.token and other.token is not env.token
    act(other)
    other.token.pop()
    with pytest.raises(RuntimeError, match=REFUSED):
        act(other)
    act(env)


@pytest.mark.parametrize("make", [single, vector, stable_baselines3])
def test_after_a_change_of_scene_one_token_guards_all(make):
    env = make()
    env.reset()
    env.set_scene(energy_weight=2.0)
    env.reset()
    inner = getattr(env, "envs", env)
    assert env.token is inner.token is inner.batch.token and len(env.token) == 1
    inner.batch.token.pop()  # as a thread at work has done
    try:
        with pytest.raises(RuntimeError, match=REFUSED):
            act(env)
    finally:
        inner.batch.token.append(None)
    act(env)


@pytest.mark.parametrize("make", [single, vector, stable_baselines3])
@pytest.mark.parametrize("call", CALLS)
def test_each_call_gives_the_token_back_even_after_an_error(make, call, monkeypatch):
    env = make()
    env.reset()
    STATES[type(env)] = {}
    wrong = {"set_state", "set_energy_cost", "set slopes"}

    if call == "set_energy_cost":
        monkeypatch.setitem(CALLS, call, lambda env: env.set_energy_cost("nothing"))
    if call == "set slopes":
        inner = getattr(env, "envs", env)
        change = inner.set_slope if hasattr(inner, "set_slope") else inner.set_slopes
        monkeypatch.setitem(CALLS, call, lambda _: change(9.0))
    if call in wrong:
        with pytest.raises(ValueError, match=r"motors|slope|state"):
            CALLS[call](env)
    elif call != "render":
        CALLS[call](env)
    assert len(getattr(env, "envs", env).token) == 1

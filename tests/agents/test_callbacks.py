"""Milestones and stop requests."""

import io
import os
import signal
import threading

import pytest
from tqdm import tqdm

from agents.callbacks import Milestones, StopRequest


class Model:
    """The attributes of an algorithm that callbacks read."""

    num_timesteps = 0
    logger = None

    def get_env(self):
        """No environment."""
        return None


def noting(model, every, stop=None):
    """Milestones, and the steps and seconds at which they were reached."""
    reached, spent = [], []

    def reach(seconds):
        reached.append(model.num_timesteps)
        spent.append(seconds)

    milestones = Milestones(every, reach, stop or StopRequest(), tqdm(disable=True))
    milestones.init_callback(model)
    return milestones, reached, spent


def rollouts(milestones, model, steps):
    """Simulate updates after which the model has made these numbers of steps."""
    for made in steps:
        model.num_timesteps = made
        milestones.on_rollout_start()


def test_seconds_of_evaluations_are_not_seconds_of_training(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("agents.callbacks.time.perf_counter", lambda: clock[0])
    model, callback = Model(), []

    def reach(seconds):
        callback.append(seconds)
        clock[0] += 1000.0

    milestones = Milestones(100, reach, StopRequest(), tqdm(disable=True))
    milestones.init_callback(model)
    for model.num_timesteps in range(0, 500, 100):
        milestones.on_rollout_start()
        clock[0] += 3.0
    assert callback == [0.0, 3.0, 3.0, 3.0, 3.0]


def test_a_signal_is_a_wish_that_is_met_between_updates():
    model = Model()
    with StopRequest() as stop:
        milestones, reached, _ = noting(model, 100, stop)
        rollouts(milestones, model, (0,))
        os.kill(os.getpid(), signal.SIGINT)
        assert milestones.on_step() is True
        rollouts(milestones, model, (40,))  # a milestone, due or not
        assert milestones.on_step() is False and milestones.stopped
    assert reached == [0, 40] and model.num_timesteps == 40


def test_progress_is_reported_at_each_step():
    model, bar = Model(), tqdm(total=100, file=io.StringIO())
    milestones = Milestones(100, lambda seconds: None, StopRequest(), bar)
    milestones.init_callback(model)
    for model.num_timesteps in (8, 16, 24):
        milestones.on_step()
    assert bar.n == 24
    bar.close()


def test_signals_are_as_before_afterwards():
    def mine(*_):
        """A handler of somebody else's."""

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, mine) for number in numbers]
    try:
        with StopRequest():
            assert all(signal.getsignal(number) is not mine for number in numbers)
        assert all(signal.getsignal(number) is mine for number in numbers)
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_either_signal_is_a_stop_request_that_is_announced(number, capsys):
    with StopRequest() as stop:
        assert not stop.made
        os.kill(os.getpid(), number)
        assert stop.made
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert "once more to stop at once" in capsys.readouterr().out


def test_another_thread_has_no_signals_to_handle():
    before, kept = signal.getsignal(signal.SIGINT), []

    def work():
        with StopRequest() as stop:
            kept.append((signal.getsignal(signal.SIGINT), stop.made))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert kept == [(before, False)]


@pytest.mark.parametrize("every", [1, 7, 100, 6400])
def test_milestones_come_once_an_interval_and_by_halves_before(every):
    """The first is at the start, the next at a 32nd of the interval, then at twice as much."""
    model = Model()
    milestones, reached, _ = noting(model, every)
    rollouts(milestones, model, range(3 * every + 1))
    early = sorted({max(1, -(-every // 2**k)) for k in range(6)})
    assert reached == [0, *early, 2 * every, 3 * every]


def test_a_resumed_run_counts_its_seconds_from_where_it_goes_on(monkeypatch):
    """And it does not repeat its milestone."""
    clock, model = [100.0], Model()
    monkeypatch.setattr("agents.callbacks.time.perf_counter", lambda: clock[0])
    model.num_timesteps = 150
    milestones, reached, spent = noting(model, 100)
    for steps in (150, 199, 200, 290, 410):
        rollouts(milestones, model, (steps,))
        clock[0] += 2.0
    model.num_timesteps = 430
    milestones.finish()
    milestones.finish()
    assert reached == [200, 410, 430] and spent == [4.0, 4.0, 2.0]

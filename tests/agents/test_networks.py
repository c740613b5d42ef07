"""Critics with a bounded scale."""

import numpy as np
import torch

from agents.config import configure
from agents.envs import training_envs
from agents.learner import build


def test_a_normed_critic_stays_bounded_far_from_what_it_has_seen():
    model = built()
    actions = torch.zeros(2, 1)
    near, far = (torch.full((2, 8), size) for size in (1.0, 1e6))
    for q_near, q_far in zip(model.critic(near, actions), model.critic(far, actions), strict=True):
        assert torch.isfinite(q_far).all()
        assert (q_far.abs() < 10.0 + 10.0 * q_near.abs()).all()


def test_critics_normalise_every_layer_but_the_last_and_actors_none():
    model = built()
    norms = [m for m in model.critic.modules() if isinstance(m, torch.nn.LayerNorm)]
    assert len(norms) == 2 * len(model.critic.q_networks)
    assert not any(isinstance(m, torch.nn.LayerNorm) for m in model.actor.modules())
    for q in model.critic.q_networks:
        assert isinstance(q[-1], torch.nn.Linear) and q[-1].out_features == 1


def test_the_optimiser_and_the_target_know_the_normed_critics():
    model = built()
    ours = {id(p) for p in model.critic.parameters()}
    held = {id(p) for group in model.critic.optimizer.param_groups for p in group["params"]}
    assert ours == held
    state, target = model.critic.state_dict(), model.critic_target.state_dict()
    assert state.keys() == target.keys()
    assert all(np.array_equal(state[name], target[name]) for name in state)


def built():
    """Untrained SAC with the preset of `level`."""
    config = configure("sac", "level", n_envs=1)
    return build(config, training_envs(config), buffer_size=10)

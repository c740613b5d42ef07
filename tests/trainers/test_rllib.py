"""PPO of RLlib, sampled by its own env runners, learns to walk.

RLlib pins an older Gymnasium: `nox -s rllib` makes an environment of its own for this.
"""

import gymnasium
import pytest

pytest.importorskip("ray.rllib.algorithms.ppo", exc_type=ImportError)
pytest.importorskip("torch")

from agents import rllib
from agents.config import configure
from gym_passive_walker.envs.evaluation.walks import HUNDRED, TIME_LIMIT, simulate_episodes
from gym_passive_walker.envs.seeds import training_seeds
from gym_passive_walker.gaits.control.baselines import Passive

pytestmark = pytest.mark.filterwarnings("ignore")  # Ray's own


@pytest.mark.learning
@pytest.mark.parametrize("runners", [0, 1], ids=["in this process", "in one of its own"])
def test_it_walks_where_a_passive_walker_falls(runners, tmp_path):
    config = configure("ppo", "level", steps=120_000, seed=0)
    learned = rllib.train(config, runners=runners, out=tmp_path / "kept", quiet=True)
    passive = simulate_episodes(Passive(), rllib.arena(config, rllib.EPISODES), seed=rllib.SEED)
    assert passive.endings.count(TIME_LIMIT) == 0
    assert learned.endings.count(TIME_LIMIT) >= 15 and (learned.strides >= HUNDRED).sum() >= 15
    assert (learned.cost_of_transport[learned.strides >= HUNDRED] > 0.0).all()
    assert any((tmp_path / "kept").iterdir())


def test_its_environments_have_the_seeds_of_trainings():
    made = [gymnasium.make_vec(f"agents.rllib:{rllib.ENVS}", 8, scene="level") for _ in range(2)]
    native = gymnasium.make_vec("gym_passive_walker:PassiveWalker-v0", 8, scene="level")
    first, other = (envs.reset(seed=seed)[0] for seed, envs in enumerate(made, 3))
    assert (first == native.reset(seed=training_seeds(3, 8))[0]).all()
    assert not {*map(tuple, first.tolist())} & {*map(tuple, other.tolist())}
    assert (made[0].reset()[0] == native.reset()[0]).all()


def test_it_samples_native_batches_as_the_preset_says():
    config = rllib.rllib_config(configure("ppo", "level", steps=1000), runners=2)
    assert config.num_envs_per_env_runner == 64 and config.num_env_runners == 2
    assert config.train_batch_size_per_learner == 2 * 64 * 64
    with pytest.raises(ValueError, match="runners"):
        rllib.rllib_config(configure("ppo", "level"), runners=-1)

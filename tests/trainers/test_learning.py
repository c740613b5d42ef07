"""Training libraries on tensors learn to walk on level ground."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor, nn  # noqa: E402

from gym_passive_walker.envs.evaluation.walks import TIME_LIMIT, Walks, simulate_episodes  # noqa: E402

pytestmark = pytest.mark.learning

WALKERS, HORIZON = 64, 64
ROLLOUT = WALKERS * HORIZON
ROLLOUTS = 40
"""Of which policies learn: 160,000 frames, a fortieth of what the shipped one has seen."""


@pytest.fixture(autouse=True)
def _alone(tmp_path, monkeypatch):
    """One thread, one seed, and a folder for files that trainers write."""
    monkeypatch.chdir(tmp_path)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    yield
    torch.set_num_threads(threads)


class Acting:
    """A trainer's policy with the `predict` of this package."""

    def __init__(self, act: Callable[[Tensor], Tensor]) -> None:
        self.act = act

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """The mean action of each walker, (n, 8) to (n, 1)."""
        with torch.no_grad():
            return self.act(torch.as_tensor(observation)).clamp(-1.0, 1.0).numpy(), state


def walks(act: Callable[[Tensor], Tensor]) -> Walks:
    """Twenty walks of the environment's own time limit."""
    arena = gymnasium.make_vec("PassiveWalker-v0", num_envs=20, scene="level")
    return simulate_episodes(Acting(act), arena, seed=0)


def learns_to_walk(
    act: Callable[[Tensor], Tensor], last: nn.Module, train: Callable[[], object]
) -> None:
    """Without a torque all walks end in falls; then most reach the time limit, with a high return.

    Args:
        act: The mean torque for observations, (n, 8) to (n, 1).
        last: The last layer of the network. With random weights it may give a constant torque with
            which many walkers walk; set to zero it is the passive walker.
        train: Function that trains.
    """
    for parameter in last.parameters():
        nn.init.zeros_(parameter)
    before = walks(act)
    assert TIME_LIMIT not in before.endings
    train()
    after = walks(act)
    assert after.endings.count(TIME_LIMIT) > 15
    assert after.reward.mean() > 38.0 > 5.0 * before.reward.mean()


def test_rsl_rl(rsl_rl_configuration):
    pytest.importorskip("rsl_rl")
    from rsl_rl.runners import OnPolicyRunner
    from tensordict import TensorDict

    from gym_passive_walker.torch.trainers.rsl_rl import RslRlWalkers

    envs = RslRlWalkers(WALKERS, max_episode_steps=400, seed=0)
    runner = OnPolicyRunner(envs, rsl_rl_configuration)

    def act(seen: Tensor) -> Tensor:
        return runner.get_inference_policy()(TensorDict({"policy": seen}, batch_size=[len(seen)]))

    def train() -> None:
        runner.learn(ROLLOUTS)

    learns_to_walk(act, runner.alg.actor.mlp[-1], train)


def test_skrl():
    pytest.importorskip("skrl")
    from skrl.agents.torch.ppo import PPO
    from skrl.memories.torch import RandomMemory
    from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
    from skrl.resources.preprocessors.torch import RunningStandardScaler
    from skrl.trainers.torch import SequentialTrainer

    from gym_passive_walker.torch.trainers.skrl import SkrlWalkers

    envs = SkrlWalkers(WALKERS, max_episode_steps=400, seed=0)
    spaces = {
        "observation_space": envs.observation_space, "action_space": envs.action_space,
        "device": envs.device,
    }  # fmt: skip

    class Actor(GaussianMixin, Model):
        """A mean torque for what is seen, and noise that is the same everywhere."""

        def __init__(self) -> None:
            Model.__init__(self, **spaces)
            GaussianMixin.__init__(self)
            self.net, self.log_std = network(), nn.Parameter(-torch.ones(1))

        def compute(self, inputs, role):
            return self.net(inputs["observations"]), {"log_std": self.log_std}

    class Critic(DeterministicMixin, Model):
        """What is still to come."""

        def __init__(self) -> None:
            Model.__init__(self, **spaces)
            DeterministicMixin.__init__(self)
            self.net = network()

        def compute(self, inputs, role):
            return self.net(inputs["observations"]), {}

    models = {"policy": Actor(), "value": Critic()}
    scaler = {"device": envs.device}
    agent = PPO(
        models=models, memory=RandomMemory(memory_size=HORIZON, num_envs=WALKERS), **spaces,
        cfg={
            "rollouts": HORIZON, "learning_epochs": 10, "mini_batches": 2, "learning_rate": 1e-3,
            "discount_factor": 0.995, "gae_lambda": 0.98, "ratio_clip": 0.1, "value_clip": 0.0,
            "value_loss_scale": 0.5, "time_limit_bootstrap": True,
            "observation_preprocessor": RunningStandardScaler,
            "observation_preprocessor_kwargs": {"size": envs.observation_space, **scaler},
            "value_preprocessor": RunningStandardScaler,
            "value_preprocessor_kwargs": {"size": 1, **scaler},
        },
    )  # fmt: skip
    reported = {
        "timesteps": ROLLOUTS * HORIZON, "headless": True, "disable_progressbar": True,
        "close_environment_at_exit": False,
    }  # fmt: skip
    trainer = SequentialTrainer(env=envs, agents=agent, cfg=reported)

    def act(seen: Tensor) -> Tensor:
        return models["policy"].net(agent._observation_preprocessor(seen))

    learns_to_walk(act, models["policy"].net[-1], trainer.train)


# torchrl warns of what it uses itself.
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_torchrl():
    pytest.importorskip("torchrl")
    from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
    from torchrl.collectors import Collector
    from torchrl.envs import ObservationNorm, TransformedEnv
    from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
    from torchrl.objectives import ClipPPOLoss
    from torchrl.objectives.value import GAE

    from gym_passive_walker.torch.trainers.torchrl import TorchRlWalkers

    scaling = ObservationNorm(in_keys=["observation"], standard_normal=True)
    envs = TransformedEnv(TorchRlWalkers(WALKERS, max_episode_steps=400, seed=0), scaling)
    scaling.init_stats(2 * ROLLOUT, reduce_dim=[0, 1], cat_dim=1)
    net, noise = network(), AddStateIndependentNormalScale(1, scale_mapping="exp", init_value=-1.0)
    actor = ProbabilisticActor(
        TensorDictModule(nn.Sequential(net, noise), ["observation"], ["loc", "scale"]),
        in_keys=["loc", "scale"], distribution_class=IndependentNormal, return_log_prob=True,
    )  # fmt: skip
    critic = ValueOperator(network(), in_keys=["observation"])
    advantage = GAE(gamma=0.995, lmbda=0.98, value_network=critic)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.1, entropy_bonus=False, critic_coeff=0.5)
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)

    def train() -> None:
        frames = {"frames_per_batch": ROLLOUT, "total_frames": ROLLOUTS * ROLLOUT}
        frames["auto_register_policy_transforms"] = False
        for rollout in Collector(envs, actor, **frames):
            for _ in range(10):
                with torch.no_grad():
                    advantage(rollout)
                rows = rollout.reshape(-1)
                for batch in torch.randperm(ROLLOUT).split(ROLLOUT // 2):
                    said = loss(rows[batch])
                    optimizer.zero_grad()
                    (said["loss_objective"] + said["loss_critic"]).backward()
                    nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                    optimizer.step()

    def act(seen: Tensor) -> Tensor:
        return net((seen - scaling.loc) / scaling.scale)

    learns_to_walk(act, net[-1], train)


def network() -> nn.Module:
    """Eight numbers to one."""
    layers = nn.Linear(8, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, 1)
    return nn.Sequential(*layers)

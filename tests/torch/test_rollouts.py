"""Walks under a policy: the environment's rewards, and their gradients."""

import numpy as np
import pytest
import torch

from gym_passive_walker import footholds, rough
from gym_passive_walker.envs.interface import OUTCOMES
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.gaits.control.feedback import powered_gait
from gym_passive_walker.gaits.scenes.scene import make_scene
from gym_passive_walker.models.equations.hybrid import Outcome
from gym_passive_walker.torch import initial_state, rollout

COUNT = 6


def network(seed=0, scale=1.0, *, sees=8, actions=1):
    """A small smooth policy in float64."""
    torch.manual_seed(seed)
    layers = (torch.nn.Linear(sees, 16), torch.nn.Tanh(), torch.nn.Linear(16, actions))
    policy = torch.nn.Sequential(*layers).double()
    with torch.no_grad():
        for parameter in policy[2].parameters():
            parameter *= scale
    return policy


class Steady(torch.nn.Module):
    """The torque that carries a walker along level ground, and a little of a smooth policy."""

    def __init__(self):
        super().__init__()
        walker = make_scene("level").walker
        powered = powered_gait(walker, 0.0).dimensionless
        self.share = torch.nn.Parameter(torch.tensor(powered.controller.hip_torque / 0.05))
        self.start = powered.state.tolist()
        self.rest = network(scale=0.05)

    def forward(self, observations):
        """Shares of the largest torque."""
        return self.share + self.rest(observations)[:, 0]


def test_gradients_go_through_hundreds_of_ticks_and_strikes():
    policy = Steady()
    scene = make_scene("level", start=tuple(policy.start), reset_noise_scale=0.01, tolerance=1e-12)
    start = initial_state(scene, COUNT, seed=1)

    def returned(parameters):
        torch.nn.utils.vector_to_parameters(parameters, policy.parameters())
        return rollout(policy, scene, 200, start=start)

    chosen = torch.nn.utils.parameters_to_vector(policy.parameters()).detach()
    walked = returned(chosen)
    assert walked.end.going.all() and (walked.outcomes == Outcome.HEELSTRIKE).sum() > 5 * COUNT
    strikes = walked.margins[walked.outcomes == Outcome.HEELSTRIKE]
    assert torch.isfinite(strikes).all() and (strikes > 0.1).all()
    walked.returns.sum().backward()
    gradient = torch.cat([p.grad.reshape(-1) for p in policy.parameters()])
    torch.manual_seed(1)
    for direction in torch.randn(3, len(chosen), dtype=torch.float64):
        step = 1e-6 * direction
        with torch.no_grad():
            ahead, behind = (returned(chosen + s).returns.sum() for s in (step, -step))
        difference = float((ahead - behind) / 2e-6)
        assert difference == pytest.approx(float(gradient @ direction), rel=1e-5)


def test_margins_are_those_of_strikes_whatever_the_tolerance():
    margins = [
        rollout(
            lambda seen: torch.full((len(seen), 1), 0.5, dtype=torch.float64),
            {"walker": "lab", "slope": 0.036, "control": "stride", "tolerance": tolerance},
            3, count=50, seed=0,
        ).margins
        for tolerance in (1e-8, 1e-4)
    ]  # fmt: skip
    np.testing.assert_allclose(*margins, rtol=1e-4)


def test_a_stride_that_falls_is_worth_nothing_and_has_no_gradient():
    """Distance alone counts here; the walkers dive in their first stride."""
    share = torch.tensor(-1.0, dtype=torch.float64, requires_grad=True)
    scene = make_scene("level", energy_weight=0.0, max_hip_torque=0.5)
    walked = rollout(lambda seen: share.expand(len(seen)), scene, 40, count=COUNT, seed=0)
    assert not walked.end.going.any() and (walked.outcomes <= Outcome.HEELSTRIKE)[0].all()
    assert (walked.outcomes != Outcome.HEELSTRIKE).all()
    torch.testing.assert_close(walked.returns, torch.zeros_like(walked.returns))
    walked.returns.sum().backward()
    assert abs(float(share.grad)) < 1e-15
    assert torch.isnan(walked.margins).sum() == COUNT


def test_a_walk_in_two_parts_is_the_walk():
    policy, scene = Steady(), make_scene("level")
    whole = rollout(policy, scene, 60, count=COUNT, seed=2)
    first = rollout(policy, scene, 25, count=COUNT, seed=2)
    second = rollout(policy, scene, 35, start=first.end)
    assert torch.equal(torch.cat([first.rewards, second.rewards]), whole.rewards)
    gradients = (
        torch.autograd.grad(returns.sum(), policy.share)
        for returns in (whole.returns, first.returns + second.returns)
    )
    torch.testing.assert_close(*gradients)
    apart = rollout(policy, scene, 35, start=first.end.detach())
    assert torch.equal(apart.rewards, second.rewards)
    assert apart.end.states.requires_grad and first.end.progress.requires_grad
    here = first.end.detach()
    tensors = [*here[:6], *here.parameters.values(), here.outcome]
    assert not any(part.requires_grad for part in tensors)


def test_walks_after_a_detached_state_have_gradients_by_its_parameters():
    scene = make_scene("level", slope=0.02)
    share = torch.tensor(0.05, dtype=torch.float64, requires_grad=True)

    def walked(start, mass):
        start = start._replace(parameters={"hip_mass": mass.expand(1)})
        return rollout(lambda seen: torch.zeros(1, 1).double(), scene, 4, start=start)

    first = walked(initial_state(scene, 1, seed=0), 2.0 * share)
    first.returns.sum().backward()
    here, share.grad = first.end.detach(), None
    assert here.parameters["hip_mass"].requires_grad and not here.states.requires_grad
    walked(here, 2.0 * share).returns.sum().backward()  # computed again: its graph was freed
    up, down = (walked(here, 2.0 * (share.detach() + h)).returns.sum() for h in (1e-5, -1e-5))
    assert float(share.grad) == pytest.approx(float(up - down) / 2e-5, rel=1e-5)


def smooth(step):
    """A reward of one's own that remembers the action before."""
    return 1.0 + step.distance - (step.action[0] - step.last_action[0]) ** 2


def tensors_of(part):
    """All tensors of what is nested."""
    if isinstance(part, torch.Tensor):
        return [part]
    return [x for each in getattr(part, "values", lambda: part)() for x in tensors_of(each)]


def test_a_detached_state_has_no_history_of_the_users_own_rules():
    policy, scene = Steady(), make_scene("level", reward=smooth)
    first = rollout(policy, scene, 5, count=2, seed=2)
    assert any(x.requires_grad for x in tensors_of(first.end.last))
    assert not any(x.requires_grad for x in tensors_of(first.end.detach()))


def test_a_reward_of_ones_own_ends_with_the_episode():
    scene = make_scene("level", reward=smooth)
    walked = rollout(lambda seen: -torch.ones(len(seen)).double(), scene, 60, count=3, seed=0)
    over = ~walked.going
    assert over.any() and (walked.rewards[walked.going] != 0.0).all()
    assert (walked.rewards[over] == 0.0).all()
    torch.testing.assert_close(walked.returns, walked.rewards.sum(0))


def test_parameters_that_are_given_prevail_over_random_ones():
    scene = make_scene("level", domain_randomization={"foot_radius": 0.1, "thigh_mass": 0.1})
    radius = torch.tensor(scene.walker.foot_radius, dtype=torch.float64, requires_grad=True)
    here = initial_state(scene, 3, seed=0, parameters={"foot_radius": radius})
    assert (here.parameters["foot_radius"] == radius).all()
    assert here.parameters["foot_radius"].requires_grad
    assert len(set(here.parameters["thigh_mass"].tolist())) == 3


def test_what_walkers_are_made_of_has_a_gradient_through_a_walk():
    policy = Steady()
    scene = make_scene("level", start=tuple(policy.start), reset_noise_scale=0.0, tolerance=1e-12)

    def returned(radius):
        start = initial_state(scene, 1, seed=0, parameters={"foot_radius": radius})
        return rollout(policy, scene, 100, start=start).returns.sum()

    radius = torch.tensor(scene.walker.foot_radius, dtype=torch.float64, requires_grad=True)
    returned(radius).backward()
    with torch.no_grad():
        difference = (returned(radius + 1e-6) - returned(radius - 1e-6)) / 2e-6
    assert float(difference) == pytest.approx(float(radius.grad), rel=1e-6)


def test_policies_of_other_numbers_are_refused():
    with pytest.raises(TypeError, match=r"policy.double\(\)"):
        rollout(lambda seen: seen[:, 0].float(), "level", 1)
    with pytest.raises(ValueError, match=r"one action for each of 16 walkers"):
        rollout(lambda seen: seen[:, :2], "level", 1)
    with pytest.raises(ValueError, match="horizon must be a whole number"):
        rollout(network(), "level", 0)


def test_functional_derivatives_go_through_rollouts_with_all_that_is_drawn():
    scene = {"walker": "C", "slope": 0.03, "terrain": rough(0.002), "action_delay": 1}
    scene |= {"pushes": {"rate": 0.3, "impulse": (-0.05, 0.05)}, "observation_noise": 0.01}
    scene["reward"] = lambda step: step.distance - step.hip_work_absolute

    def walked(weights):
        def policy(seen):
            return torch.tanh(seen[:, :8] @ weights)[:, None]

        return rollout(policy, scene, 8, count=3, seed=1).returns.sum()

    weights = torch.full((8,), 0.1, dtype=torch.float64, requires_grad=True)
    (expected,) = torch.autograd.grad(walked(weights), weights)
    for derivative in (torch.func.grad, torch.func.jacfwd):
        torch.testing.assert_close(derivative(walked)(weights.detach()), expected)


def test_a_rollout_begins_with_walkers_of_its_scene():
    scene = {"walker": "C", "slope": 0.03}
    late = scene | {"action_delay": 2}
    with pytest.raises(ValueError, match=r"its pending have shape \('n', 0, 1\)"):
        rollout(network(), late, 3, start=initial_state(scene, 2))
    with pytest.raises(ValueError, match=r"foot_radius must be a number or \(2,\), not \(3,\)"):
        initial_state(scene, 2, parameters={"foot_radius": [0.1, 0.2, 0.3]})
    locked = initial_state(scene, 2)._replace(phases=torch.tensor([1, 0]))
    with pytest.raises(ValueError, match="phase must be 0, as strides of"):
        rollout(network(), {"walker": "E", "slope": 0.01}, 3, start=locked)


DRIVEN = {
    "walker": "E", "slope": 0.009, "actions": ("hip", "ankle", "push_off"), "tick": 0.4,
    "tolerance": 1e-13, "reset_noise_scale": 0.003, "energy": "positive", "max_push_off": 0.02,
    "max_hip_torque": 0.01, "max_ankle_torque": 0.01,
}  # fmt: skip


@pytest.mark.parametrize(
    "changes",
    [{}, {"terrain": {"rough": {"height_std": 0.001, "slope_std": 0.002}}, "terrain_lookahead": 1},
     {"command": 0.2, "command_weight": 1.0}],
)  # fmt: skip
def test_every_motor_and_every_push_has_its_gradient_on_any_ground(changes):
    """Through several strides, by what the motors are given and by pushes on the hip."""
    scene, ticks = make_scene(DRIVEN | changes), 21
    torch.manual_seed(2)
    shares = 0.05 * torch.rand(3, dtype=torch.float64) + 0.01
    pushes = 1e-4 * torch.randn(ticks, COUNT, dtype=torch.float64)

    def returned(shares, pushes):
        policy = lambda seen: shares + 1e-3 * seen[:, :3]  # noqa: E731
        return rollout(policy, scene, ticks, count=COUNT, seed=1, pushes=pushes)

    walked = returned(shares.requires_grad_(), pushes.requires_grad_())
    assert walked.end.going.all() and walked.end.strides.sum() > COUNT
    given = (shares, pushes)
    gradients = torch.autograd.grad(walked.returns.sum(), given)
    for part, gradient in enumerate(gradients):
        assert (gradient.abs() > 1e-6).any()
        for direction in torch.randn(2, *gradient.shape, dtype=torch.float64):
            moved = [
                1e-6 * direction if i == part else torch.zeros_like(x) for i, x in enumerate(given)
            ]
            with torch.no_grad():
                ahead, behind = (
                    returned(
                        *(x + sign * by for x, by in zip(given, moved, strict=True))
                    ).returns.sum()
                    for sign in (1.0, -1.0)
                )
            difference = float((ahead - behind) / 2e-6)
            assert difference == pytest.approx(float((gradient * direction).sum()), rel=1e-5)


@pytest.mark.parametrize("walker", ["A", "lab", "lab-straight", "D"])
def test_a_push_of_a_rollout_is_the_environment_s(walker):
    scene = {"walker": walker, "slope": 0.02 if walker == "A" else 0.009, "reset_noise_scale": 0.0}
    scene = make_scene(scene if walker != "lab" else scene | {"slope": 0.036})
    pushes = torch.zeros((12, 1), dtype=torch.float64)
    pushes[4] = 0.02
    walked = rollout(lambda seen: 0.0 * seen[:, 0], scene, 12, count=1, seed=0, pushes=pushes)
    idle = make_scene(scene, pushes={"rate": 0.0, "impulse": 0.0})
    env = PassiveWalkerVectorEnv(1, idle)
    env.reset(seed=0)
    env.batch.schedule_events(impulses=[0.02], times=[4 * scene.tick])
    for k in range(12):
        _, rewards, *_ = env.step(np.zeros((1, 1), np.float32))
        assert rewards[0] == pytest.approx(float(walked.rewards[k, 0]), abs=1e-9)
    units = scene.walker.units
    found = units.to_dimensionless(env.batch.states)
    np.testing.assert_allclose(walked.end.states, found, atol=1e-8)


def test_what_is_no_push_and_what_constraints_end_is_refused():
    with pytest.raises(ValueError, match=r"pushes must be a number or of shape \(5, 16\)"):
        rollout(lambda seen: seen[:, 0], "level", 5, pushes=np.zeros((4, 16)))
    with pytest.raises(ValueError, match="rollouts check no constraints, and friction end"):
        rollout(network(), {"constraints": {"friction": "end", "contact": "report"}}, 5)


def test_a_heelstrike_just_after_the_start_of_a_control_step_has_its_margin():
    """Its guard is differentiated just before it: there the step has not ended yet."""
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (60, 5, 1)).astype(np.float32)
    plan = iter(torch.from_numpy(actions.astype(float)))
    walked = rollout(lambda seen: next(plan), "rough", 60, count=5, seed=3)
    assert torch.isfinite(walked.rewards).all()


@pytest.mark.parametrize("of", ["height_change", "slope_change", "slope"])
def test_own_rewards_at_heelstrikes_see_the_ground_of_the_stride_that_begins(of):
    rough = {"height_std": 0.001, "slope_std": 0.001}
    ground = {"terrain": {"rough": rough}, "reset_noise_scale": 0.0, "tick": 0.5}
    scene = make_scene("lab", **ground, reward=lambda step: getattr(step, of))
    envs = PassiveWalkerVectorEnv(COUNT, scene, autoreset_mode="Disabled")
    envs.reset(seed=0)
    walked = rollout(lambda seen: 0.0 * seen[:, :1], scene, 20, count=COUNT, seed=0)
    struck = np.zeros(COUNT, int)
    for k in range(20):
        assert walked.going[k].all()
        _, rewards, _, _, infos = envs.step(np.zeros((COUNT, 1), np.float32))
        np.testing.assert_allclose(walked.rewards[k], rewards, rtol=0.0, atol=1e-12)
        struck = infos["strides"]
    assert (struck >= 2).all() and len(np.unique(walked.rewards)) >= 2 * COUNT


@pytest.mark.parametrize("walker", ["C", "E"])
def test_own_functions_see_at_the_beginning_whether_the_knee_is_locked(walker):
    scene = make_scene("lab", walker=walker, observation=lambda step: step.knee_locked)
    seen, _ = PassiveWalkerVectorEnv(1, scene).reset(seed=0)
    walked = rollout(lambda seen: 0.0 * seen, scene, 1, count=1, seed=0)
    assert walked.observations.item() == seen.item() == (walker == "E")


@pytest.mark.parametrize("stops", [lambda step: step.heelstrike, lambda step: step.time > 1.05])
def test_an_own_termination_leaves_the_outcomes_of_steps_as_the_environment_has_them(stops):
    scene = make_scene("level", terminated=stops, reset_noise_scale=0.0)
    walked = rollout(lambda seen: 0.0 * seen[:, :1], scene, 60, count=1, seed=0)
    env = PassiveWalkerVectorEnv(1, scene, autoreset_mode="Disabled")
    env.reset(seed=0)
    for outcome in walked.outcomes[walked.going]:
        terminated, _, infos = env.step(np.zeros((1, 1), np.float32))[2:]
        assert (infos["outcome"][0] or "") == OUTCOMES[outcome]
    assert terminated.all() and OUTCOMES[walked.end.outcome] == "stopped"


def test_footholds_are_those_of_a_terrain_and_have_gradients():
    heights, slopes = 1e-3 * np.array([0.0, 0.3, -0.4, 0.0]), 1e-3 * np.array([0, 1, -1, 1])
    policy, horizon, changes = Steady(), 100, np.stack([np.diff(heights), np.diff(slopes)], 1)
    about = {"start": tuple(policy.start), "reset_noise_scale": 0.01, "tolerance": 1e-12}
    smooth = make_scene("level", **about)
    listed = footholds(heights, slopes)
    on_list = rollout(policy, make_scene(smooth, terrain=listed), horizon, count=2, seed=0)
    given = torch.tensor(changes, requires_grad=True)
    own = initial_state(smooth, 2, seed=0, footholds=given)
    walked = rollout(policy, smooth, horizon, start=own)
    assert (walked.end.strides > 2).all()
    torch.testing.assert_close(walked.rewards, on_list.rewards, rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(walked.observations, on_list.observations, rtol=1e-9, atol=1e-12)
    # Beside a terrain's footholds they add up.
    doubled = initial_state(make_scene(smooth, terrain=listed), 2, seed=0, footholds=-given)
    level = rollout(policy, make_scene(smooth, terrain=listed), horizon, start=doubled)
    plain = rollout(policy, smooth, horizon, count=2, seed=0)
    torch.testing.assert_close(level.rewards, plain.rewards, rtol=1e-9, atol=1e-12)
    walked.returns.sum().backward()
    for place in ((0, 0), (1, 0), (0, 1), (2, 1)):
        returns = []
        for step in (1e-6, -1e-6):
            moved = changes.copy()
            moved[place] += step
            start = initial_state(smooth, 2, seed=0, footholds=moved)
            with torch.no_grad():
                returns.append(rollout(policy, smooth, horizon, start=start).returns.sum())
        difference = float(returns[0] - returns[1]) / 2e-6
        assert difference == pytest.approx(float(given.grad[place]), rel=1e-5)
    with pytest.raises(ValueError, match=r"footholds must have shape \(k, 2\) or \(k, 2, 2\)"):
        initial_state(smooth, 2, footholds=np.zeros((3, 4, 2)))

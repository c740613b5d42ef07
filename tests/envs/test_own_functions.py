"""Hundreds of forms of users' functions: right in every way that they are called, or refused."""

import operator
import pickle
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from gym_passive_walker.engine import machine
from gym_passive_walker.envs import rule as rules
from gym_passive_walker.envs.rule import Rule
from gym_passive_walker.envs.vector_env import PassiveWalkerVectorEnv
from gym_passive_walker.envs.views import Shape, of_notes, of_one, samples
from gym_passive_walker.envs.walker_env import PassiveWalkerEnv
from gym_passive_walker.gaits.scenes.scene import SceneError, make_scene
from gym_passive_walker.models.expressions import REFUSED, Expression, read
from tests.envs.forms import CALLED, COMPILED, function, plain_values, several

SHAPE = Shape(1)


@pytest.fixture(scope="module")
def notes():
    """Transitions of walkers that step, strike and fall."""
    scene = make_scene("rough", command=(0.1, 0.2), pushes={"rate": 0.3, "impulse": 0.01})
    env = PassiveWalkerVectorEnv(4, scene, observation=several(COMPILED), terrain_lookahead=0)
    env.reset(seed=2)
    random, found = np.random.default_rng(1), []
    for _ in range(150):
        env.step(random.uniform(-1.0, 1.0, (4, 1)))
        found.append(env.batch.custom.notes.copy())
    found = np.concatenate(found)
    some = [*np.flatnonzero(found["heelstrike"])[:8], *np.flatnonzero(found["fell"])[:8]]
    assert len(some) > 10
    return found[[*some, *range(0, len(found), 19)]]


@pytest.fixture(scope="module")
def expected(notes):
    """Their values in plain Python."""
    return plain_values(COMPILED, notes, SHAPE)


def close(found, expected, forms):
    """Compare results (n, forms) to rounding."""
    for column, other, form in zip(np.transpose(found), expected.T, forms, strict=True):
        np.testing.assert_allclose(column, other, rtol=1e-12, atol=1e-14, err_msg=form)


def test_compiled_forms_are_those_of_plain_python(notes, expected):
    assert len(COMPILED) > 300
    rule = Rule("observation", several(COMPILED), SHAPE)
    assert rule.native
    close(rule._of_code(rule.native, notes), expected, COMPILED)


@pytest.mark.parametrize("name", ["reward", "terminated"])
def test_compiled_forms_add_up_in_rewards_and_terminations(name, notes, expected):
    forms, sizes = list(COMPILED), np.sqrt(2.0 + np.arange(len(COMPILED)))
    for k in range(0, len(forms), 60):
        each, weights = several(forms[k : k + 60]), sizes[k : k + 60]

        def paid(step, each=each, weights=weights):
            return sum(w * x for w, x in zip(weights, each(step), strict=True))

        rule = Rule(name, paid, SHAPE)
        assert rule.native
        terms = expected[:, k : k + 60] * weights
        np.testing.assert_allclose(
            rule._of_code(rule.native, notes)[:, 0], terms.sum(axis=1), rtol=1e-11, atol=1e-9
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reward", "terminated"])
def test_each_compiled_form_alone_is_a_reward_and_a_termination(name, notes, expected):
    found = []
    for form in COMPILED:
        rule = Rule(name, function(form), SHAPE)
        assert rule.native, form
        found.append(rule._of_code(rule.native, notes)[:, 0])
    close(np.transpose(found), expected, COMPILED)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_forms_are_the_same_of_arrays_and_of_single_numbers(notes, expected):
    alone = [several(COMPILED)(of_one(note, SHAPE)) for note in notes[:, None]]
    close(np.array(alone, float), expected, COMPILED)
    forms = {form: k for k, form in enumerate(COMPILED) if "np.sum" not in form}  # over walkers
    together = several(forms)(of_notes(notes, SHAPE))
    columns = [np.broadcast_to(np.asarray(x, float), len(notes)) for x in together]
    close(np.transpose(columns), expected[:, [*forms.values()]], forms)


def test_forms_are_the_same_of_tensors(notes, expected):
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch.counting import applied

    def tensors(part):
        if isinstance(part, np.ndarray):
            return torch.from_numpy(np.array(part))
        each = map(tensors, part)
        return type(part)._make(each) if hasattr(part, "_make") else tuple(each)

    step = tensors(of_notes(notes, SHAPE))
    forms = {form: k for k, form in enumerate(COMPILED) if "np." not in form}
    values = applied(several(forms), step)
    close(torch.stack(values, 1).numpy(), expected[:, [*forms.values()]], forms)


@pytest.mark.parametrize("form", CALLED)
def test_forms_that_cannot_be_compiled_say_why_and_are_called(form, notes):
    with pytest.warns(UserWarning) as said:
        rule = Rule("reward", function(form), SHAPE)
    (warning,) = said
    assert rule.native == 0 and CALLED[form] in str(warning.message) and "line 2: " in rule.untraced
    close(rule(notes), plain_values([form], notes, SHAPE), [form])


def test_each_walks_as_it_was_called(expected):
    """The single and the vector environment, and their notes."""
    scene = make_scene(observation=several(COMPILED), reward=several(["s.distance - 5 * s.fell"]))
    env, one = PassiveWalkerVectorEnv(2, scene, autoreset_mode="Disabled"), PassiveWalkerEnv(scene)
    env.reset(seed=0), one.reset(seed=0)
    for _ in range(80):
        seen, paid, ended, *_ = env.step(np.full((2, 1), 0.9))
        mine, reward, over, *_ = one.step(np.full(1, 0.9))
        np.testing.assert_array_equal(mine, seen[0])
        assert reward == paid[0] and over == ended[0]
        notes = env.batch.custom.notes
        np.testing.assert_allclose(seen, plain_values(COMPILED, notes, SHAPE), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(paid, notes["distance"] - 5.0 * notes["fell"], rtol=1e-12)
        if ended.any():
            break
    assert paid[ended].min() < -4.0


def test_walks_on_tensors_are_judged_by_the_same_forms():
    torch = pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    forms = [form for form in COMPILED if "np." not in form]
    paid = several(["s.distance - 5 * s.fell + 0.1 * ~s.heelstrike - (s.steps == 7)"])
    ends = several(["(s.time > 0.65) * s.steps - s.knee_locked"])
    scene = make_scene(
        reward=lambda s: paid(s)[0], observation=several(forms), terminated=lambda s: ends(s)[0]
    )
    walk = rollout(lambda seen: torch.full((3, 1), 0.9).double(), scene, 9, count=3, seed=0)
    env = PassiveWalkerVectorEnv(3, scene, autoreset_mode="Disabled")
    seen, _ = env.reset(seed=0)
    for k in range(8):
        going = walk.going[k].numpy()
        np.testing.assert_allclose(walk.observations[k][going], seen[going], rtol=1e-5, atol=1e-5)
        if not going.all():
            break
        seen, rewards, ended, *_ = env.step(np.full((3, 1), 0.9))
        np.testing.assert_allclose(walk.rewards[k], rewards, rtol=1e-6, atol=1e-8)
        np.testing.assert_array_equal(walk.outcomes[k] > 1, ended)
    assert ended.any()


OPERATORS = (
    {name for name in dir(operator) if name.startswith("__") and callable(getattr(operator, name))}
    - {
        name
        for name in dir(object)
        if name not in ("__eq__", "__ne__", "__lt__", "__le__", "__gt__", "__ge__")
    }
    - {"__spec__", "__loader__"}
)
NO_NUMBERS = {"__call__", "__concat__", "__iconcat__", "__contains__", "__delitem__", "__getitem__",
              "__setitem__"}  # fmt: skip
DEFINED = {
    "__abs__", "__add__", "__and__", "__eq__", "__ge__", "__gt__", "__iadd__", "__iand__",
    "__imul__", "__inv__", "__invert__", "__ior__", "__ipow__", "__isub__", "__itruediv__",
    "__ixor__", "__le__", "__lt__", "__mul__", "__ne__", "__neg__", "__or__", "__pos__", "__pow__",
    "__sub__", "__truediv__", "__xor__",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_every_operator_of_python_is_defined_for_traced_numbers_or_refused(name):
    """Of all that this Python has; a new one is refused unless it is defined."""
    of, known = getattr(operator, name), {}
    numbers = [read(known, "x"), read(known, "y")]
    conditions = [x > 0.3 for x in numbers]
    found = []
    for given in (numbers, conditions, [numbers[0], 2], [2, numbers[0]], [conditions[0], True]):
        for count in (1, 2):
            try:
                found.append(of(*given[:count]))
            except TypeError:
                continue
    results = [x for x in found if not isinstance(x, int)]  # of 2 and True alone
    assert all(isinstance(x, Expression) for x in results)
    assert bool(results) == (name in DEFINED)


def test_every_method_of_python_s_numbers_is_defined_for_traced_numbers_or_raises():
    plain = {name for kind in (int, float, complex, bool) for name in dir(kind)}
    own = {name for name in plain if name.startswith("__")} - set(dir(object))
    own -= {"__getnewargs__", "__getformat__"}  # of copies and of the type
    assert own <= set(dir(Expression))
    for method in {name for names in REFUSED.values() for name in names}:
        with pytest.raises(TypeError, match="has no compiled form"):
            getattr(read({}, "x"), f"__{method}__")(2)


@pytest.mark.parametrize(
    "given", [lambda x: [*x], len, iter, lambda x: x[0], lambda x: 1 in x, lambda x: x in (1, 2),
              set, lambda x: f"{x:.2f}", lambda x: x(), lambda x: x + "1", lambda x: x == None,  # noqa: E711
              lambda x: ~x, lambda x: x & 1, lambda x: x + np.ones(2).tolist()],
)  # fmt: skip
def test_what_is_no_operation_on_numbers_is_refused(given):
    with pytest.raises(TypeError):
        given(read({}, "x"))


def centred(step):
    """A mean over walkers."""
    return np.sin(step.distance) - np.mean(np.asarray(step.distance))


def any_fell(step):
    """A reduction of conditions."""
    return np.where(np.any(step.fell), -1.0, 0.0) + 0.0 * np.sin(step.time)


def later(step):
    """One that mixes walkers only in the course of an episode."""
    late = np.max(step.steps) < 10.0 if np.max(step.time) < 1.0 else False
    return np.sin(step.distance - (np.mean(step.distance) if late else 0.0))


@pytest.mark.parametrize("rule", [centred, any_fell, later])
def test_functions_that_mix_walkers_are_called_walker_by_walker(rule):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        env = PassiveWalkerVectorEnv(4, reward=rule)
        assert ("walker by walker" in str(said[0].message)) == (rule is not later)
        for _ in range(2):
            env.reset(seed=0)
            for _ in range(5):
                _, paid, *_ = env.step(np.array([[0.1], [-0.2], [0.3], [0.6]]))
                alone = [rule(of_one(note, SHAPE)) for note in env.batch.custom.notes[:, None]]
                np.testing.assert_allclose(paid, np.array(alone, float), rtol=1e-12)
    assert len(said) == 1 + (rule is later)
    assert "walker by walker" in str(said[-1].message)


def test_a_walk_on_tensors_refuses_functions_that_mix_walkers():
    pytest.importorskip("torch")
    from gym_passive_walker.torch import rollout

    def mixed(step):
        return step.distance - step.distance.mean()

    with pytest.warns(UserWarning), pytest.raises(SceneError, match="reward mixes walkers"):
        rollout(lambda seen: 0.0 * seen[:, :1], {"reward": mixed}, 2, count=3)


def forgotten(step):
    """Without a return."""
    step.distance - step.energy


@pytest.mark.parametrize("name", ["reward", "observation", "terminated"])
@pytest.mark.parametrize(
    ("rule", "said"),
    [
        (forgotten, r"must return numbers, and forgotten returns None; its `return` is missing"),
        (lambda s: s.step_length / s.step_period, "returns nan in a step within a stride"),
        (lambda s: s.fell * float("nan"), "returns nan"),
        (lambda s: np.log(-1.0 - s.time), "returns nan"),
        (lambda s: "12.5", "returns '12.5'"),
        (lambda s: 1j * s.time, "must return numbers"),
        (lambda s: {"paid": s.time}, "must return numbers"),
        (lambda s: [s.time, None][int(s.knee_locked)], "returns None; its `return` is missing"),
    ],
)  # fmt: skip
def test_what_is_no_number_is_refused_with_the_name_of_the_function(name, rule, said):
    with pytest.raises(SceneError, match=f"^{name} must.*{said}|^{name} .*{said}"):
        PassiveWalkerVectorEnv(2, **{name: rule})


def sometimes(step):
    """A number until an episode has lasted for a while."""
    return None if 0.45 < step.time < 0.55 else step.distance


def test_a_forgotten_return_is_refused_when_it_is_met():
    with pytest.warns(UserWarning, match="walker by walker"):
        env = PassiveWalkerVectorEnv(2, reward=sometimes)
    env.reset(seed=0)
    with pytest.raises(SceneError, match="reward must return numbers, and sometimes returns None"):
        for _ in range(6):
            env.step(np.zeros((2, 1)))


def grows(step):
    """Two numbers from the sixth step on."""
    return [step.time] * (2 if 5.5 < step.steps < 7.5 else 1)


def test_more_numbers_than_before_are_refused():
    with pytest.warns(UserWarning, match="walker by walker"):
        env = PassiveWalkerVectorEnv(2, reward=grows)
    env.reset(seed=0)
    with pytest.raises(SceneError, match="reward gives 2 numbers, and gave 1"):
        for _ in range(6):
            env.step(np.zeros((2, 1)))


def test_an_observation_that_is_no_number_at_a_reset_is_refused():
    with pytest.raises(SceneError, match="nan when an episode begins"):
        PassiveWalkerVectorEnv(2, observation=lambda s: s.distance / s.duration)
    assert Rule("reward", lambda s: s.distance / s.duration, SHAPE).native


def test_a_function_that_compiled_is_another_is_called():
    """Compiled code counts only if it gives what Python gives, for each of the steps tried."""

    def kinds(step):
        return 1.0 if isinstance(step.time, float) else step.time

    with pytest.warns(UserWarning, match="compiled it would return 7.3 where Python returns 1"):
        rule = Rule("reward", kinds, SHAPE)
    assert rule.native == 0 and (rule(samples(SHAPE, begun=False)) == 1.0).all()


@pytest.mark.parametrize("name", ["reward", "observation"])
def test_a_compilation_that_fails_late_leaves_nothing_behind(name, monkeypatch):
    def fail(_):
        raise RuntimeError("LLVM IR parsing error\n<string>:22:13: error: '%v9' defined with type")

    monkeypatch.setattr(machine, "object_code", fail)
    with pytest.warns(UserWarning, match="compiler does not accept") as said:
        rule = Rule(name, lambda s: s.distance - 100.0 * s.fell, SHAPE)
    assert "LLVM" not in str(said[0].message) and "%v" not in str(said[0].message)
    assert (rule.native, rule.noted, rule.size) == (0, rules._ALL, 1)
    with pytest.warns(UserWarning, match="with arrays"):
        env = PassiveWalkerVectorEnv(2, reward=lambda s: s.time - 100.0 * s.fell)
    env.reset(seed=0)
    np.testing.assert_allclose(env.step(np.zeros((2, 1)))[1], 0.1)


HELD = SimpleNamespace(price=1.0)


def priced(step):
    """A reward with a value that it holds."""
    return HELD.price * step.distance


def clocked(step):
    """What an agent sees."""
    return step.time, step.distance


def test_values_that_a_function_holds_are_read_when_it_is_compiled_and_changes_are_reported():
    HELD.price = 1.0
    env = PassiveWalkerVectorEnv(2, reward=priced, observation=clocked)
    env.reset(seed=0)
    again = pickle.loads(pickle.dumps(env))
    again.reset(seed=0)
    HELD.price = 3.0
    with pytest.warns(UserWarning, match=r"reward has other constants .*set_scene\(reward"):
        env.reset(seed=0)
    action = np.full((2, 1), 0.1)
    seen, paid, *_ = env.step(action)
    np.testing.assert_allclose(paid, seen[:, 1], rtol=1e-6)
    with pytest.warns(UserWarning, match="reward has other constants"):
        copy = pickle.loads(pickle.dumps(env))
    copy.reset(seed=0)
    np.testing.assert_allclose(copy.step(action)[1], 3.0 * paid)
    env.set_scene(reward=priced)
    env.step(action)
    env.reset(seed=0)
    np.testing.assert_allclose(env.step(action)[1], 3.0 * paid)

"""Changes that no test can notice, and why: they change no walk, or only its cost."""

EQUIVALENT: dict[str, str] = {
    "events.root: low + high -> low - high": (
        "leaves the bracket where the slope is exactly 0; the next line then takes its middle"
    ),
    "integrator.extent: T.NEW_RATE + coordinate -> T.NEW_RATE - coordinate": (
        "weighs an error by the rates of fewer legs: within the hundred tolerances promised"
    ),
    "landing.candidates: phase == E.FREE and np.abs(k1) >= np.pi -> phase == E.FREE or "
    "np.abs(k1) >= np.pi": ("looks at more events, none of which has happened"),
    "integrator.judge: error <= 0.1 -> error > 0.1": (
        "proposes another length for the first step after a tick, which is tried like any other"
    ),
    "ledger.kinetic_energy: state[1] -> state[2] (2)": (
        "the thigh's and the shank's angle of a straight leg are the same"
    ),
    "tile.go_on: 1.1 * following.real -> 1.1110000000000002 * following.real": (
        "the last steps before a time is up are shared out another way"
    ),
    "landing.candidates: ahead * get(tile, T.NEW_RATE, lane).real -> "
    "ahead / get(tile, T.NEW_RATE, lane).real": (
        "looks ahead by another share of a correction that is a millionth of a step"
    ),
    "landing.fell: get(tile, T.NEW_ANGLE, lane).real < 0.0 -> "
    "get(tile, T.NEW_ANGLE, lane).real < 0.01": (
        "a foot that comes down behind is landed on, found to be behind, and goes on"
    ),
    "runge_kutta._table: STAGES + 1 -> STAGES + 2": "leaves a row of zeros that nothing reads",
    "engine.module: _WORTH_A_THREAD = 1024 -> _WORTH_A_THREAD = 1025": (
        "threads change no result, only when a second one is worth its start"
    ),
}

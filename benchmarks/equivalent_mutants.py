"""Equivalent mutants, with the reason: they change no result, or only the run time."""

EQUIVALENT: dict[str, str] = {
    "engine/event_location.root: low + high -> low - high": (
        "leaves the bracket where the slope is exactly 0; the next line then takes its middle"
    ),
    "engine/step.module: STRETCH = 1.1 -> STRETCH = 1.1110000000000002": (
        "the last steps before a strike or a time's end are shared out another way"
    ),
    "engine/step.classify: factor >= MUCH -> factor < MUCH": (
        "proposes another length for the first step after a tick, which is tried like any other"
    ),
    "engine/run.module: _WORTH_A_THREAD = 1024 -> _WORTH_A_THREAD = 1025": (
        "threads change no result, only when a second one is worth its start"
    ),
}

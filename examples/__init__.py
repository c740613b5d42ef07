"""Examples of controllers; each is a module to read, to run and to copy.

python -m examples.potential_shaping    Torques that act as another gravity.
python -m examples.stride_controllers        Feedback with one action at each heelstrike.
"""

"""Examples of controllers: each is a module to read, to run and to copy.

python -m examples.potential_shaping    torques that make a walker feel another gravity
python -m examples.once_a_stride        feedback that chooses one action at each heelstrike
"""

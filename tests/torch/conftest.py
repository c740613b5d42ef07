"""What walks on tensors needs them."""

from importlib.util import find_spec

# They come with the extra "train".
collect_ignore_glob = [] if find_spec("torch") else ["*"]

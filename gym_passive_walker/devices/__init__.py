"""The engine on other machines: GPUs and web pages."""

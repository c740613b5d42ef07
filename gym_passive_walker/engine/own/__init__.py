"""Systems that users state themselves, by their masses or by their equations."""

"""Systems that users state."""

"""The engine against independent mechanics."""

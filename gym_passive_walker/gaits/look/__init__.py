"""What a stride and a gait consist of."""

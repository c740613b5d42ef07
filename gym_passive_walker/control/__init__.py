"""Door to `gaits.control`: controllers."""

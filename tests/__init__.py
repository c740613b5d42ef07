"""What walkers do, as statements that can fail."""

"""rods."""

"""mechanics.splittings."""

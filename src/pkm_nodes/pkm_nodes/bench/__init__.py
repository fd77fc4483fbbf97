"""How fast the servo tick is, against what the middleware allows; see `pkm bench`."""

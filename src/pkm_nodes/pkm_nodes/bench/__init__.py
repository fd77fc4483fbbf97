"""Rate of the servo tick against the limit of the middleware; see `pkm bench`."""

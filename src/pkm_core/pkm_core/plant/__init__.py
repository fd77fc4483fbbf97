"""The simulated machine, tick by tick; the only room that reads the truth."""

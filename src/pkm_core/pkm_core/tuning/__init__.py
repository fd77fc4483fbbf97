"""Search for the gains of the robust controllers by a genetic algorithm."""

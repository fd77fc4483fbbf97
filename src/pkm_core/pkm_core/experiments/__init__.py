"""The experiments of chapters 7 and 8 over several noise seeds, with the values of the thesis."""

"""Evaluation of bags: the final table and figure of `pkm run`, and the page of `pkm report`."""

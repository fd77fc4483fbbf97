"""What bags have to tell: the table and picture `pkm run` ends with, and the page of `pkm report`."""

"""The experiments of chapters 7 and 8: what is driven over how many noise seeds; figures beside the thesis's."""

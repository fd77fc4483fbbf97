"""Design tools: chapters 3 and 4 of the thesis and what a designer asks next."""

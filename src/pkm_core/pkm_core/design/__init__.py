"""Design tools: chapters 3 and 4 of the thesis, error budget and calibration."""

"""MCAP bags: reading, writing, repair, and the record of one cycle."""

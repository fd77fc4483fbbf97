"""Campaign of faults against a running cell: seeded, bounded, outside of the default tests; see docs/reliability.md."""

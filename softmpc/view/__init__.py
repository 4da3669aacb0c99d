"""What people see: plots, animations, tables. Imported by `cli` and examples only."""

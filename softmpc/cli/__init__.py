"""The command line; may import every room, each only where a command needs it."""

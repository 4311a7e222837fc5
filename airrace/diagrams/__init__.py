"""How the systems are wired, configured and run."""

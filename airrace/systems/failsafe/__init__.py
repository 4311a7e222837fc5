"""What happens when a part fails: watchdogs over commands and set-points, and lost rotors."""

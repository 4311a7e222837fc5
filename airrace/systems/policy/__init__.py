"""Who flies without a plan: a network, what it sees and commands, and when it hands back."""

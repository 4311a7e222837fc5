"""The log of a race, race.mcap: what is in it, and in which form."""

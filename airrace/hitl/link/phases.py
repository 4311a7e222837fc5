"""What an end of the link is at, as the `phase` of its heartbeats says."""

COMPILING = "compiling"  # the autonomy's, the first time: it will wait for the other end then
WAITING = "waiting"  # for the other end
TESTING = "testing"  # the simulation's: a doctor measures the link, and a race may follow
READY = "ready"  # to race, once the other end is
RACING = "racing"
OVER = "over"  # the simulation's: the autonomy may wait for the next race

#!/bin/sh
# The first program of a container, see Containerfile: airrace, with the options given.
#
# The page of a race is served on loopback only, which here is the container's own. What comes
# from outside, by `docker run --publish 127.0.0.1:7100:7100`, is handed on to it; who may ask
# it stays what it is (docs/security.md).
address=$(hostname -I 2>/dev/null | cut -d ' ' -f 1)
if [ -n "$address" ]; then  # there is a network
  socat "TCP-LISTEN:7100,bind=$address,fork,reuseaddr" TCP:127.0.0.1:7100 2>/dev/null &
fi
exec /opt/airrace/bin/airrace "$@"

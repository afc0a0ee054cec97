#!/usr/bin/env bash
# Tells whether the node of this container still serves its callbacks, for Docker's health check.
#
# Usage: health.sh [PORT]      with a port, an HTTP server must answer there, too
#
# A node touches the file that BICYCLE_HEARTBEAT names once a second; more than 5 s without is too long.
# Exit status: 0 it does, 1 it does not.
set -euo pipefail
age_allowed=5

touched=$(stat -c %Y "$BICYCLE_HEARTBEAT" 2>/dev/null) || { echo "no heartbeat yet" && exit 1; }
age=$(($(date +%s) - touched))
((age <= age_allowed)) || { echo "no heartbeat for $age s" && exit 1; }
if (($#)); then
  exec 3<>"/dev/tcp/127.0.0.1/$1"
  printf 'GET / HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n' >&3
  read -r -t 3 answer <&3 && [[ $answer == HTTP/1.*" 200 "* ]] || { echo "port $1: ${answer:-no answer}" && exit 1; }
fi
